#pragma once

#include "nilio/core/result.hpp"

#include "drivers/can/dbc/lexer.hpp"

#include <charconv>
#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <type_traits>
#include <vector>

namespace nilio::drivers {

/// Text in quotes for messages, cut to 40 characters, with other than printable ASCII replaced by '?'.
std::string quoted(std::string_view text);

/// Returns UTF-8 unchanged and converts any other text from Latin-1, the encoding of most DBC files.
std::string to_utf8(std::string_view text);

/// Parses a whole word as a number, with an optional plus sign.
template <class Number>
bool parse_dbc_number(const DbcToken& token, Number& value) {
  std::string_view text = token.text;
  if (text.starts_with('+')) text.remove_prefix(1);
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool valid =
      token.kind == DbcTokenKind::kWord && code == std::errc{} && end == text.data() + text.size();
  if constexpr (std::is_floating_point_v<Number>) return valid && std::isfinite(value);
  return valid;
}

/// Takes expected tokens from a file. After a missing token, which is the error, no token is taken until
/// recover().
class DbcReader {
 public:
  DbcReader(std::string_view text, std::string path) : lexer_(text), path_(std::move(path)) {}

  [[nodiscard]] const DbcToken& peek() const { return lexer_.peek(); }
  DbcToken take() { return lexer_.take(); }
  [[nodiscard]] bool at_end() const { return error_ || peek().kind == DbcTokenKind::kEnd; }
  [[nodiscard]] const std::optional<core::Error>& error() const { return error_; }

  template <class Number>
  Number take_number(const char* what) {
    Number value{};
    if (error_) return value;
    const DbcToken token = take();
    if (!parse_dbc_number(token, value)) fail_expected(token, what);
    return value;
  }
  std::string take_word(const char* what);
  std::string take_string(const char* what);
  void expect(std::string_view symbol);
  /// Takes the tokens up to the semicolon, or to the next line that begins with a keyword: VERSION, BU_ and
  /// BS_ have no semicolon, and some files omit others.
  std::vector<DbcToken> take_statement();

  /// Returns the error ("path:line: problem") of the statement that `keyword` begins, forgets it, and
  /// continues at the next statement.
  std::string recover(const DbcToken& keyword);

  void fail(const DbcToken& token, const std::string& what);
  void fail_expected(const DbcToken& token, const std::string& what);

 private:
  DbcLexer lexer_;
  const std::string path_;
  std::optional<core::Error> error_;
  DbcToken failed_at_;
};

/// Remarks about a file; equal remarks are merged.
class DbcNotes {
 public:
  void add(int line, const std::string& text);
  [[nodiscard]] std::vector<std::string> texts() const;

 private:
  struct Note {
    int first_line = 0;
    std::size_t count = 0;
  };
  std::map<std::string, Note, std::less<>> notes_;
  std::size_t omitted_ = 0;
};

}  // namespace nilio::drivers
