#include "tools/bench/odometry/table.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace nilio::tools {

std::string to_text(const BenchTable& table) {
  std::vector<std::size_t> widths;
  for (const std::string& heading : table.headings) widths.push_back(heading.size());
  for (const auto& row : table.rows) {
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  std::string text;
  const auto add_row = [&](const std::vector<std::string>& row) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      const std::string padding(widths[i] - row[i].size(), ' ');
      text += i == 0 ? row[i] + padding : "  " + padding + row[i];
    }
    text += '\n';
  };
  add_row(table.headings);
  for (const auto& row : table.rows) add_row(row);
  return text;
}

std::string to_markdown(const BenchTable& table) {
  std::string text = "|";
  for (const std::string& heading : table.headings) text += " " + heading + " |";
  text += "\n|";
  for (std::size_t i = 0; i < table.headings.size(); ++i) text += i == 0 ? "---|" : "---:|";
  text += '\n';
  for (const auto& row : table.rows) {
    text += "|";
    for (const std::string& cell : row) text += " " + cell + " |";
    text += '\n';
  }
  return text;
}

std::string fixed(double value, int digits) {
  if (!std::isfinite(value)) return "-";
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%.*f", digits, value);
  return text.data();
}

}  // namespace nilio::tools
