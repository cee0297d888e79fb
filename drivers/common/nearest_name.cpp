#include "nilio/drivers/common/nearest_name.hpp"

#include <algorithm>
#include <cctype>
#include <numeric>
#include <vector>

namespace nilio::drivers {
namespace {

constexpr std::size_t kFewCandidates = 12;

char lower(char c) { return static_cast<char>(std::tolower(static_cast<unsigned char>(c))); }

/// Levenshtein distance, one row at a time.
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i + 1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t substituted = diagonal + (lower(a[i]) == lower(b[j]) ? 0U : 1U);
      diagonal = row[j + 1];
      row[j + 1] = std::min({substituted, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row[b.size()];
}

}  // namespace

std::optional<std::string> nearest_name(std::string_view wanted, std::span<const std::string> candidates) {
  std::size_t best = std::max<std::size_t>(2, wanted.size() / 3) + 1;
  std::optional<std::string> result;
  for (const std::string& candidate : candidates) {
    const std::size_t distance = edit_distance(wanted, candidate);
    // Names with all letters different are no misspellings, however short.
    if (distance >= best || distance >= std::max(wanted.size(), candidate.size())) continue;
    best = distance;
    result = candidate;
  }
  return result;
}

std::string nearest_name_hint(std::string_view wanted, std::span<const std::string> candidates) {
  if (const auto nearest = nearest_name(wanted, candidates)) return " (did you mean '" + *nearest + "'?)";
  if (candidates.empty() || candidates.size() > kFewCandidates) return {};
  std::string hint = " (there are: ";
  for (std::size_t i = 0; i < candidates.size(); ++i) hint += (i == 0 ? "" : ", ") + candidates[i];
  return hint + ")";
}

}  // namespace nilio::drivers
