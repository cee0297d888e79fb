#pragma once

#include <string>
#include <string_view>

namespace nilio::drivers {

enum class DbcTokenKind { kWord, kString, kSymbol, kEnd, kUnterminatedString };

struct DbcToken {
  DbcTokenKind kind = DbcTokenKind::kEnd;
  /// Without the quotes of a string.
  std::string_view text;
  int line = 1;
  bool first_on_line = false;

  [[nodiscard]] bool is(std::string_view expected) const {
    return kind != DbcTokenKind::kString && text == expected;
  }
  /// First on its line and spelled like a keyword.
  [[nodiscard]] bool begins_statement() const {
    return first_on_line && kind == DbcTokenKind::kWord && text.ends_with('_');
  }
};

/// Splits a DBC text into tokens: quoted strings (which may span lines), symbols, and words, which include
/// numbers. Holds views into the text.
class DbcLexer {
 public:
  explicit DbcLexer(std::string_view text);

  [[nodiscard]] const DbcToken& peek() const { return next_; }
  DbcToken take();
  /// Continues behind the line on which `token` begins, or at `token` itself if it begins a statement there.
  void resume_after(const DbcToken& token);

 private:
  DbcToken scan();
  DbcToken scan_string(DbcToken token);
  void skip_blanks();

  std::string_view text_;
  std::size_t position_ = 0;
  int line_ = 1;
  bool line_start_ = true;
  DbcToken next_;
};

}  // namespace nilio::drivers
