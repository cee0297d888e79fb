#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/capture/file_kind.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <variant>

namespace nilio::tools {

/// The error of a file that cannot be written, with what to check.
core::Error cannot_write(const std::filesystem::path& path);

/// All bytes of a file; unset when it cannot be read.
std::optional<std::string> file_text(const std::filesystem::path& path);

/// Writes a file, or says why not.
core::Result<std::monostate> write_text(const std::filesystem::path& path, const std::string& text);

/// A large file that has its name only when it is complete, so that an interrupted program leaves nothing
/// that could be taken for a whole recording. One thread.
class UnfinishedFile {
 public:
  /// Removes an earlier file of that name.
  explicit UnfinishedFile(std::filesystem::path path);

  /// Path to write to.
  [[nodiscard]] std::string path() const { return path_.string() + std::string(drivers::kPartialSuffix); }
  /// Gives the written and closed file its name.
  [[nodiscard]] core::Result<std::monostate> finish() const;

 private:
  std::filesystem::path path_;
};

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
