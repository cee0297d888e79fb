#pragma once

#include <string>
#include <vector>

namespace nilio::tools {

/// Rows of text under headings; the first column is flushed left, numbers right.
struct BenchTable {
  std::vector<std::string> headings;
  std::vector<std::vector<std::string>> rows;
};

/// Aligned columns for a terminal.
std::string to_text(const BenchTable& table);
std::string to_markdown(const BenchTable& table);

/// A number with so many digits behind the point; "-" for one that is not finite.
std::string fixed(double value, int digits);

}  // namespace nilio::tools
