#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace nilio::drivers {

/// Candidate with the smallest edit distance to `wanted`, ignoring case; nothing beyond two edits, or a third
/// of a longer name. The first of several at the same distance.
std::optional<std::string> nearest_name(std::string_view wanted, std::span<const std::string> candidates);

/// End of an error message about an unknown name: " (did you mean 'x'?)"; without a near candidate
/// " (there are: a, b)" when they are few; otherwise empty.
std::string nearest_name_hint(std::string_view wanted, std::span<const std::string> candidates);

}  // namespace nilio::drivers
