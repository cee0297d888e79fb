#include "drivers/can/dbc/lexer.hpp"

#include <algorithm>
#include <cstddef>

namespace nilio::drivers {
namespace {

constexpr std::string_view kBlanks = " \t\r\n\v\f";
constexpr std::string_view kSymbols = ":;|@()[],";
constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";

}  // namespace

DbcLexer::DbcLexer(std::string_view text) : text_(text) {
  if (text_.starts_with(kByteOrderMark)) text_.remove_prefix(kByteOrderMark.size());
  next_ = scan();
}

DbcToken DbcLexer::take() {
  const DbcToken token = next_;
  next_ = scan();
  return token;
}

void DbcLexer::resume_after(const DbcToken& token) {
  if (token.kind == DbcTokenKind::kEnd) return;
  position_ = static_cast<std::size_t>(token.text.data() - text_.data());
  line_ = token.line;
  line_start_ = token.begins_statement();
  if (!line_start_) position_ = std::min(text_.find('\n', position_), text_.size());
  next_ = scan();
}

void DbcLexer::skip_blanks() {
  while (position_ < text_.size() && kBlanks.find(text_[position_]) != std::string_view::npos) {
    if (text_[position_] == '\n') {
      ++line_;
      line_start_ = true;
    }
    ++position_;
  }
}

DbcToken DbcLexer::scan() {
  skip_blanks();
  DbcToken token;
  token.line = line_;
  token.first_on_line = line_start_;
  line_start_ = false;
  if (position_ >= text_.size()) return token;
  const char c = text_[position_];
  if (c == '"') return scan_string(token);
  if (kSymbols.find(c) != std::string_view::npos) {
    token.kind = DbcTokenKind::kSymbol;
    token.text = text_.substr(position_++, 1);
    return token;
  }
  const std::size_t begin = position_;
  while (position_ < text_.size() && text_[position_] != '"' &&
         kBlanks.find(text_[position_]) == std::string_view::npos &&
         kSymbols.find(text_[position_]) == std::string_view::npos) {
    ++position_;
  }
  token.kind = DbcTokenKind::kWord;
  token.text = text_.substr(begin, position_ - begin);
  return token;
}

DbcToken DbcLexer::scan_string(DbcToken token) {
  const std::size_t begin = ++position_;
  while (position_ < text_.size() && text_[position_] != '"') {
    if (text_[position_] == '\\' && position_ + 1 < text_.size()) ++position_;
    if (text_[position_] == '\n') ++line_;
    ++position_;
  }
  token.kind = position_ < text_.size() ? DbcTokenKind::kString : DbcTokenKind::kUnterminatedString;
  token.text = text_.substr(begin, position_ - begin);
  if (position_ < text_.size()) ++position_;
  return token;
}

}  // namespace nilio::drivers
