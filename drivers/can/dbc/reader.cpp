#include "drivers/can/dbc/reader.hpp"

#include <algorithm>
#include <cstdint>
#include <utility>

namespace nilio::drivers {
namespace {

constexpr std::size_t kQuotedTokenLength = 40;
/// Number of different notes kept for one file.
constexpr std::size_t kMostNotes = 64;

/// Length in bytes of the UTF-8 character at the front of `text`; 0 for invalid UTF-8.
std::size_t utf8_length(std::string_view text) {
  const auto lead = static_cast<std::uint8_t>(text.front());
  std::size_t length = 0;
  if (lead < 0x80) {
    length = 1;
  } else if (lead >= 0xC2 && lead < 0xE0) {
    length = 2;
  } else if (lead >= 0xE0 && lead < 0xF0) {
    length = 3;
  } else if (lead >= 0xF0 && lead < 0xF5) {
    length = 4;
  }
  if (length > text.size()) return 0;
  for (std::size_t i = 1; i < length; ++i) {
    if ((static_cast<std::uint8_t>(text[i]) & 0xC0U) != 0x80U) return 0;
  }
  return length;
}

bool is_utf8(std::string_view text) {
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    if (length == 0) return false;
    text.remove_prefix(length);
  }
  return true;
}

}  // namespace

std::string quoted(std::string_view text) {
  std::string result = "'";
  for (const char c : text.substr(0, kQuotedTokenLength)) result.push_back(c >= ' ' && c < '\x7F' ? c : '?');
  return result + (text.size() > kQuotedTokenLength ? "...'" : "'");
}

std::string to_utf8(std::string_view text) {
  if (is_utf8(text)) return std::string(text);
  std::string result;
  for (const char c : text) {
    const auto byte = static_cast<std::uint8_t>(c);
    if (byte < 0x80) {
      result.push_back(c);
    } else {
      result.push_back(static_cast<char>(0xC0U | (byte >> 6U)));
      result.push_back(static_cast<char>(0x80U | (byte & 0x3FU)));
    }
  }
  return result;
}

std::string DbcReader::take_word(const char* what) {
  if (error_) return {};
  const DbcToken token = take();
  if (token.kind != DbcTokenKind::kWord) fail_expected(token, what);
  return std::string(token.text);
}

std::string DbcReader::take_string(const char* what) {
  if (error_) return {};
  const DbcToken token = take();
  if (token.kind != DbcTokenKind::kString || token.text.find('\n') != std::string_view::npos)
    fail_expected(token, std::string(what) + " in quotes on one line");
  return to_utf8(token.text);
}

void DbcReader::expect(std::string_view symbol) {
  if (error_) return;
  const DbcToken token = take();
  if (!token.is(symbol)) fail_expected(token, "'" + std::string(symbol) + "'");
}

std::vector<DbcToken> DbcReader::take_statement() {
  std::vector<DbcToken> tokens;
  while (!at_end()) {
    const DbcToken& next = peek();
    if (next.begins_statement()) break;
    const DbcToken token = take();
    if (token.kind == DbcTokenKind::kUnterminatedString) fail(token, "this string is never closed");
    if (token.is(";")) break;
    tokens.push_back(token);
  }
  return tokens;
}

std::string DbcReader::recover(const DbcToken& keyword) {
  std::string problem = std::exchange(error_, std::nullopt).value_or(core::Error{}).message;
  // A statement that fails at its keyword is not read again.
  if (failed_at_.text.data() == keyword.text.data()) failed_at_.first_on_line = false;
  lexer_.resume_after(failed_at_);
  while (!at_end() && !peek().begins_statement()) take();
  return problem;
}

void DbcReader::fail(const DbcToken& token, const std::string& what) {
  if (error_) return;
  error_ = core::Error{path_ + ":" + std::to_string(token.line) + ": " + what};
  failed_at_ = token;
}

void DbcReader::fail_expected(const DbcToken& token, const std::string& what) {
  const std::string found =
      token.kind == DbcTokenKind::kEnd ? std::string("the end of the file") : quoted(token.text);
  fail(token, "expected " + what + ", found " + found);
}

void DbcNotes::add(int line, const std::string& text) {
  const auto known = notes_.find(text);
  if (known != notes_.end()) {
    ++known->second.count;
  } else if (notes_.size() < kMostNotes) {
    notes_.emplace(text, Note{line, 1});
  } else {
    ++omitted_;
  }
}

std::vector<std::string> DbcNotes::texts() const {
  std::vector<std::pair<int, std::string>> sorted;
  for (const auto& [text, note] : notes_) {
    const std::string times = note.count > 1 ? " (" + std::to_string(note.count) + " times)" : "";
    sorted.emplace_back(note.first_line, "line " + std::to_string(note.first_line) + ": " + text + times);
  }
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<std::string> texts;
  texts.reserve(sorted.size() + 1);
  for (auto& [line, text] : sorted) texts.push_back(std::move(text));
  if (omitted_ > 0) texts.push_back("and " + std::to_string(omitted_) + " further remarks");
  return texts;
}

}  // namespace nilio::drivers
