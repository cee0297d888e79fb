#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace nilio::drivers {

/// The candidate that `wanted` is most likely a misspelling of (edit distance, ignoring case), or nothing
/// when none is near: at most two edits, or a third of a longer name. The first of equally near ones.
std::optional<std::string> nearest_name(std::string_view wanted, std::span<const std::string> candidates);

/// The end of an error message about an unknown name: " (did you mean 'x'?)", or the candidates when none is
/// near and they are few: " (there are: a, b)", or nothing.
std::string nearest_name_hint(std::string_view wanted, std::span<const std::string> candidates);

}  // namespace nilio::drivers
