#pragma once

#include "nilio/core/result.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <utility>

namespace nilio::tools {

/// All bytes of a file; unset when it cannot be read.
std::optional<std::string> file_text(const std::filesystem::path& path);

/// Temporary folder of a measurement, removed with this object.
class WorkFolder {
 public:
  /// Creates the folder in TMPDIR; fails when that is not writable.
  static core::Result<WorkFolder> create();
  WorkFolder(WorkFolder&& other) noexcept : path_(std::exchange(other.path_, {})) {}
  WorkFolder& operator=(WorkFolder&&) = delete;
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;
  ~WorkFolder();

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  explicit WorkFolder(std::filesystem::path path) : path_(std::move(path)) {}

  std::filesystem::path path_;
};

}  // namespace nilio::tools
