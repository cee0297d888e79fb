#pragma once

#include "nilio/core/result.hpp"

#include <string>
#include <string_view>

namespace nilio::tools::view {

/// Name of a Host header without its port: "localhost:8480" and "[::1]:8480" give "localhost" and "::1".
std::string host_name(const std::string& host);

/// A path of at most 1 kB of letters, digits and ". _ - /" without "..": the only ones that are looked up.
bool is_plain_path(std::string_view path);

/// "Bearer TOKEN".
bool is_bearer(const std::string& authorization, const std::string& token);

/// Takes the same time for every text of the same length.
bool equals_in_constant_time(std::string_view a, std::string_view b);

/// 32 hexadecimal digits from the kernel's generator.
std::string random_token();

core::Result<std::string> gunzip(const std::string& compressed);
std::string gzip(const std::string& content);

}  // namespace nilio::tools::view
