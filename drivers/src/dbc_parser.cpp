#include "nilio/drivers/dbc.hpp"

#include "dbc_lexer.hpp"

#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <sstream>

namespace nilio::drivers {
namespace {

using core::Error;

constexpr std::uint32_t kExtendedFlag = 0x80000000U;
constexpr std::uint32_t kIdMask = 0x1FFFFFFFU;
/// Vector's tools park signals that belong to no message in this one.
constexpr std::uint32_t kIndependentSignals = 0xC0000000U;
constexpr std::uint16_t kLongestSignal = 64;
constexpr std::size_t kQuotedLength = 40;

std::string quoted(std::string_view text) {
  std::string result = "'";
  for (const char c : text.substr(0, kQuotedLength)) result.push_back(c >= ' ' && c < '\x7F' ? c : '?');
  return result + (text.size() > kQuotedLength ? "...'" : "'");
}

/// Recursive descent over the statements; the first error ends it.
class DbcParser {
 public:
  DbcParser(std::string_view text, const std::string& path) : lexer_(text) { database_.path = path; }

  core::Result<DbcDatabase> parse() {
    while (lexer_.peek().kind != DbcTokenKind::kEnd && !error_) parse_statement();
    if (error_) return *error_;
    if (database_.messages.empty()) {
      return Error{database_.path + ": no message (BO_) in this file; is it a DBC file?"};
    }
    return std::move(database_);
  }

 private:
  void parse_statement() {
    const DbcToken keyword = lexer_.take();
    if (keyword.is("BO_")) return parse_message();
    if (keyword.is("SG_")) return parse_signal(keyword);
    if (keyword.is("SIG_VALTYPE_")) return parse_value_type();
    if (keyword.is("NS_")) return skip_new_symbols();
    skip_statement(keyword);
  }

  /// The keywords listed after NS_ are no statements.
  void skip_new_symbols() {
    if (lexer_.peek().is(":")) lexer_.take();
    while (lexer_.peek().kind == DbcTokenKind::kWord && !lexer_.peek().is("BS_") &&
           !lexer_.peek().is("BU_") && !lexer_.peek().is("BO_") && !lexer_.peek().is("SG_")) {
      lexer_.take();
    }
  }

  /// To the semicolon, or to the next line that begins as a statement does (VERSION, BU_ and BS_ have no
  /// semicolon).
  void skip_statement(const DbcToken& keyword) {
    DbcToken token = keyword;
    while (token.kind != DbcTokenKind::kEnd) {
      if (token.kind == DbcTokenKind::kUnterminatedString) return fail(token, "this string is never closed");
      if (token.is(";")) return;
      const DbcToken& next = lexer_.peek();
      if (next.first_on_line && next.kind == DbcTokenKind::kWord && next.text.ends_with('_')) return;
      token = lexer_.take();
    }
  }

  void parse_message() {
    DbcMessage message;
    const auto id = take_number<std::uint32_t>("the message's identifier");
    message.name = take_word("the message's name");
    expect(":");
    message.length = take_number<std::uint16_t>("the message's length in bytes");
    take_word("the message's sender");
    message.extended = (id & kExtendedFlag) != 0;
    message.id = id & kIdMask;
    if (error_) return;
    independent_signals_ = id == kIndependentSignals;
    has_message_ = true;
    if (!independent_signals_) database_.messages.push_back(std::move(message));
  }

  void parse_signal(const DbcToken& keyword) {
    if (!has_message_) return fail(keyword, "signal (SG_) before any message (BO_)");
    DbcSignal signal;
    signal.name = take_word("the signal's name");
    if (!lexer_.peek().is(":")) {
      // "M" is the multiplexer itself and always there; "m3" and "m3M" are there when it says so.
      signal.multiplexed = take_word("':' or a multiplexing mark").starts_with('m');
    }
    expect(":");
    parse_layout(signal);
    expect("(");
    signal.factor = take_number<double>("the factor");
    expect(",");
    signal.offset = take_number<double>("the offset");
    expect(")");
    expect("[");
    signal.minimum = take_number<double>("the minimum");
    expect("|");
    signal.maximum = take_number<double>("the maximum");
    expect("]");
    signal.unit = take_string("the unit");
    skip_receivers();
    if (!error_ && !independent_signals_) database_.messages.back().signals.push_back(std::move(signal));
  }

  /// start|length@order-and-sign, as "7|16@0-".
  void parse_layout(DbcSignal& signal) {
    signal.start_bit = take_number<std::uint16_t>("the start bit");
    expect("|");
    const DbcToken length_token = lexer_.peek();
    signal.length = take_number<std::uint16_t>("the length in bits");
    if (!error_ && (signal.length == 0 || signal.length > kLongestSignal)) {
      return fail(length_token, "a signal has 1 to 64 bits, not " + quoted(length_token.text));
    }
    expect("@");
    const DbcToken order = lexer_.take();
    const bool valid = order.text.size() == 2 && (order.text[0] == '0' || order.text[0] == '1') &&
                       (order.text[1] == '+' || order.text[1] == '-');
    if (!valid)
      return fail(order,
                  "expected byte order and sign ('0+', '0-', '1+' or '1-'), found " + quoted(order.text));
    signal.little_endian = order.text[0] == '1';
    signal.is_signed = order.text[1] == '-';
  }

  void skip_receivers() {
    while (lexer_.peek().kind != DbcTokenKind::kEnd && !lexer_.peek().first_on_line) lexer_.take();
  }

  /// SIG_VALTYPE_ id signal : 1;
  void parse_value_type() {
    const auto id = take_number<std::uint32_t>("the message's identifier");
    const DbcToken name_token = lexer_.peek();
    const std::string name = take_word("the signal's name");
    if (lexer_.peek().is(":")) lexer_.take();
    const auto type = take_number<int>("the value type (0, 1 or 2)");
    expect(";");
    if (error_ || type == 0) return;
    const std::uint16_t length = type == 1 ? 32 : 64;
    for (DbcMessage& message : database_.messages) {
      if (message.id != (id & kIdMask) || message.extended != ((id & kExtendedFlag) != 0)) continue;
      for (DbcSignal& signal : message.signals) {
        if (signal.name != name) continue;
        if (signal.length != length)
          return fail(name_token, "floating-point signal " + quoted(name) + " has not 32 or 64 bits");
        signal.value_type = type == 1 ? DbcValueType::kFloat32 : DbcValueType::kFloat64;
      }
    }
  }

  template <class Number>
  Number take_number(const char* what) {
    if (error_) return Number{};
    const DbcToken token = lexer_.take();
    std::string_view text = token.text;
    if (text.starts_with('+')) text.remove_prefix(1);
    Number value{};
    const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
    bool valid = token.kind == DbcTokenKind::kWord && code == std::errc{} && end == text.data() + text.size();
    if constexpr (std::is_floating_point_v<Number>) valid = valid && std::isfinite(value);
    if (!valid) fail(token, std::string("expected ") + what + ", found " + describe(token));
    return value;
  }

  std::string take_word(const char* what) {
    if (error_) return {};
    const DbcToken token = lexer_.take();
    if (token.kind != DbcTokenKind::kWord)
      fail(token, std::string("expected ") + what + ", found " + describe(token));
    return std::string(token.text);
  }

  std::string take_string(const char* what) {
    if (error_) return {};
    const DbcToken token = lexer_.take();
    if (token.kind != DbcTokenKind::kString)
      fail(token, std::string("expected ") + what + " in quotes, found " + describe(token));
    return std::string(token.text);
  }

  void expect(std::string_view symbol) {
    if (error_) return;
    const DbcToken token = lexer_.take();
    if (!token.is(symbol)) fail(token, "expected '" + std::string(symbol) + "', found " + describe(token));
  }

  static std::string describe(const DbcToken& token) {
    return token.kind == DbcTokenKind::kEnd ? "the end of the file" : quoted(token.text);
  }

  void fail(const DbcToken& token, const std::string& what) {
    if (!error_) error_ = Error{database_.path + ":" + std::to_string(token.line) + ": " + what};
  }

  DbcLexer lexer_;
  DbcDatabase database_;
  std::optional<Error> error_;
  bool has_message_ = false;
  bool independent_signals_ = false;
};

}  // namespace

const DbcMessage* DbcDatabase::find(std::string_view message_name) const {
  for (const DbcMessage& message : messages) {
    if (message.name == message_name) return &message;
  }
  return nullptr;
}

const DbcSignal* DbcDatabase::find(std::string_view message_name, std::string_view signal_name) const {
  const DbcMessage* message = find(message_name);
  if (message == nullptr) return nullptr;
  for (const DbcSignal& signal : message->signals) {
    if (signal.name == signal_name) return &signal;
  }
  return nullptr;
}

core::Result<DbcDatabase> parse_dbc(std::string_view text, const std::string& path) {
  return DbcParser(text, path).parse();
}

core::Result<DbcDatabase> load_dbc(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  if (file) text << file.rdbuf();
  if (!file || file.bad()) {
    return Error{path + ": cannot be read (" + std::strerror(errno) +
                 "); check the path and its permissions"};
  }
  return parse_dbc(text.str(), path);
}

}  // namespace nilio::drivers
