#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

namespace nilio::daemon {

/// SHA-256 of bytes that are added one after another (OpenSSL). One thread.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;

  void add(std::string_view bytes);
  /// Adds a file's content and returns its size; the error names the file.
  core::Result<std::uint64_t> add_file(const std::filesystem::path& path);
  /// Digest of everything added so far as 64 hexadecimal digits, as sha256sum prints it.
  [[nodiscard]] std::string hex() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Digest of the bytes alone.
std::string sha256(std::string_view bytes);

}  // namespace nilio::daemon
