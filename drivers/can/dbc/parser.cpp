#include "nilio/drivers/can/dbc/dbc.hpp"

#include "drivers/can/dbc/statements.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>

namespace nilio::drivers {
namespace {

using core::Error;

/// Pseudo-message of Vector's tools for signals without a message.
constexpr std::uint32_t kIndependentSignals = 0xC0000000U;
constexpr std::uint16_t kLongestSignal = 64;
/// Number of warnings kept for one file.
constexpr std::size_t kMostWarnings = 64;
constexpr const char* kMarkExpected = "':' or a multiplexing mark (M, m3 or m3M)";

/// Recursive-descent parser of the statements; one that cannot be read is skipped with a warning.
class DbcParser {
 public:
  DbcParser(std::string_view text, const std::string& path) : reader_(text, path) { database_.path = path; }

  core::Result<DbcDatabase> parse() {
    while (!reader_.at_end()) {
      const DbcToken keyword = reader_.take();
      parse_statement(keyword);
      if (reader_.error()) skip(keyword);
    }
    if (!first_problem_.empty() && !has_signal()) return Error{first_problem_};
    if (database_.messages.empty()) {
      return Error{database_.path + ": no message (BO_) in this file; is it a DBC file?"};
    }
    for (const std::string& problem : resolve_multiplexers(database_)) add_warning(problem);
    for (std::size_t i = 0; i < database_.messages.size(); ++i) {
      note_contradictions(database_.messages[i], message_lines_[i], notes_);
    }
    attributes_.apply(database_, index_);
    database_.notes = notes_.texts();
    if (more_warnings_ > 0)
      database_.warnings.push_back(database_.path + ": " + std::to_string(more_warnings_) +
                                   " further statements are skipped");
    return std::move(database_);
  }

 private:
  /// Owner of the signals that follow.
  enum class Context { kNoMessage, kMessage, kIgnored };

  [[nodiscard]] bool has_signal() const {
    return std::any_of(database_.messages.begin(), database_.messages.end(),
                       [](const DbcMessage& message) { return !message.signals.empty(); });
  }

  /// Continues behind a statement that cannot be read.
  void skip(const DbcToken& keyword) {
    const std::string problem = reader_.recover(keyword);
    if (first_problem_.empty()) first_problem_ = problem;
    if (keyword.is("BO_")) {
      context_ = Context::kIgnored;
      return add_warning(problem + "; the message and its signals are skipped");
    }
    if (!keyword.is("SG_")) return add_warning(problem + "; the statement is skipped");
    if (context_ != Context::kIgnored) add_warning(problem + "; the signal is skipped");
  }

  void add_warning(const std::string& text) {
    if (database_.warnings.size() == kMostWarnings) {
      ++more_warnings_;
    } else {
      database_.warnings.push_back(text);
    }
  }

  void parse_statement(const DbcToken& keyword) {
    if (keyword.kind == DbcTokenKind::kUnterminatedString) {
      return reader_.fail(keyword, "this string is never closed");
    }
    if (keyword.is("BO_")) return parse_message(keyword);
    if (keyword.is("SG_")) return parse_signal(keyword);
    if (keyword.is("SIG_VALTYPE_")) return parse_value_type();
    if (keyword.is("NS_")) return skip_new_symbols();
    parse_loose_statement(keyword, reader_.take_statement());
  }

  /// Parses statements whose errors are only noted, because the file remains usable.
  void parse_loose_statement(const DbcToken& keyword, const std::vector<DbcToken>& statement) {
    if (reader_.error()) return;
    if (keyword.is("SG_MUL_VAL_")) {
      return read_extended_multiplexing(keyword, statement, database_, index_, reader_);
    }
    if (keyword.is("CM_")) return read_comment(statement, database_, index_, notes_);
    if (keyword.is("VAL_TABLE_")) return value_tables_.define(statement, notes_);
    if (keyword.is("VAL_")) return value_tables_.assign(statement, database_, index_, notes_);
    if (keyword.is("BA_DEF_")) return attributes_.define(statement);
    if (keyword.is("BA_DEF_DEF_")) return attributes_.set_default(statement);
    if (keyword.is("BA_")) return attributes_.assign(statement);
    const bool header = keyword.is("VERSION") || keyword.is("BS_") || keyword.is("BU_") || keyword.is(";");
    if (!header) notes_.add(keyword.line, quoted(keyword.text) + " is not used");
  }

  /// Skips the keywords listed after NS_, which are no statements.
  void skip_new_symbols() {
    if (reader_.peek().is(":")) reader_.take();
    while (reader_.peek().kind == DbcTokenKind::kWord && !reader_.peek().is("BS_") &&
           !reader_.peek().is("BU_") && !reader_.peek().is("BO_") && !reader_.peek().is("SG_")) {
      reader_.take();
    }
  }

  void parse_message(const DbcToken& keyword) {
    DbcMessage message;
    const auto id = reader_.take_number<std::uint32_t>("the message's identifier");
    message.name = reader_.take_word("the message's name");
    reader_.expect(":");
    message.length = reader_.take_number<std::uint16_t>("the message's length in bytes");
    reader_.take_word("the message's sender");
    message.extended = (id & kDbcExtendedFlag) != 0;
    message.id = id & kDbcIdMask;
    if (reader_.error()) return;
    context_ = id == kIndependentSignals ? Context::kIgnored : Context::kMessage;
    if (context_ == Context::kIgnored) return;
    if (!index_.add(id, database_.messages.size())) {
      notes_.add(keyword.line, "message " + quoted(message.name) +
                                   " has the identifier of a message above, " + std::to_string(id) +
                                   "; further statements about it apply to the first");
    }
    message_lines_.push_back(keyword.line);
    database_.messages.push_back(std::move(message));
  }

  void parse_signal(const DbcToken& keyword) {
    if (context_ == Context::kNoMessage)
      return reader_.fail(keyword, "signal (SG_) before any message (BO_)");
    DbcSignal signal;
    signal.name = reader_.take_word("the signal's name");
    if (!reader_.peek().is(":")) parse_multiplexing(signal);
    reader_.expect(":");
    parse_layout(signal);
    reader_.expect("(");
    signal.factor = reader_.take_number<double>("the factor");
    reader_.expect(",");
    signal.offset = reader_.take_number<double>("the offset");
    reader_.expect(")");
    reader_.expect("[");
    signal.minimum = reader_.take_number<double>("the minimum");
    reader_.expect("|");
    signal.maximum = reader_.take_number<double>("the maximum");
    reader_.expect("]");
    signal.unit = reader_.take_string("the unit");
    skip_receivers();
    if (reader_.error() || context_ == Context::kIgnored) return;
    database_.messages.back().signals.push_back(std::move(signal));
  }

  /// "M" is the multiplexer itself and always present; "m3" is present when its value is 3; "m3M" is a
  /// multiplexer as well.
  void parse_multiplexing(DbcSignal& signal) {
    if (reader_.error()) return;
    DbcToken mark = reader_.take();
    const DbcToken whole = mark;
    signal.multiplexer = mark.text.ends_with('M');
    if (mark.kind == DbcTokenKind::kWord && mark.text == "M") return;
    signal.multiplexed = mark.text.starts_with('m');
    if (signal.multiplexed) mark.text.remove_prefix(1);
    if (signal.multiplexer) mark.text.remove_suffix(1);
    DbcRange range;
    if (!signal.multiplexed || !parse_dbc_number(mark, range.first)) {
      return reader_.fail_expected(whole, kMarkExpected);
    }
    range.last = range.first;
    signal.selected_by.push_back(range);
  }

  /// Parses start|length@order-and-sign, as "7|16@0-".
  void parse_layout(DbcSignal& signal) {
    signal.start_bit = reader_.take_number<std::uint16_t>("the start bit");
    reader_.expect("|");
    const DbcToken length_token = reader_.peek();
    signal.length = reader_.take_number<std::uint16_t>("the length in bits");
    if (reader_.error()) return;
    if (signal.length == 0 || signal.length > kLongestSignal) {
      return reader_.fail(length_token, "a signal has 1 to 64 bits, not " + quoted(length_token.text));
    }
    reader_.expect("@");
    if (reader_.error()) return;
    const DbcToken order = reader_.take();
    const bool valid = order.text.size() == 2 && (order.text[0] == '0' || order.text[0] == '1') &&
                       (order.text[1] == '+' || order.text[1] == '-');
    if (!valid) return reader_.fail_expected(order, "byte order and sign ('0+', '0-', '1+' or '1-')");
    signal.little_endian = order.text[0] == '1';
    signal.is_signed = order.text[1] == '-';
  }

  void skip_receivers() {
    while (!reader_.at_end() && !reader_.peek().first_on_line) reader_.take();
  }

  /// Parses "SIG_VALTYPE_ id signal : 1;". A signal of unknown type has no value and is removed.
  void parse_value_type() {
    const auto id = reader_.take_number<std::uint32_t>("the message's identifier");
    const DbcToken name_token = reader_.peek();
    const std::string name = reader_.take_word("the signal's name");
    if (reader_.peek().is(":")) reader_.take();
    const DbcToken type_token = reader_.peek();
    const auto type = reader_.take_number<int>("the value type (0 to 2)");
    DbcSignal* signal = index_.find(database_, id, name);
    if (signal == nullptr && !reader_.error()) {
      return notes_.add(name_token.line, "value type (SIG_VALTYPE_) of a signal that is not in the file");
    }
    if (reader_.peek().is(";")) reader_.take();
    if (type < 0 || type > 2) reader_.fail_expected(type_token, "the value type (0 to 2)");
    if (type > 0 && signal != nullptr && signal->length != (type == 1 ? 32 : 64))
      reader_.fail(name_token, "floating-point signal " + quoted(name) + " has not 32 or 64 bits");
    if (signal == nullptr || (type == 0 && !reader_.error())) return;
    if (reader_.error()) return remove_signal(*index_.find(database_, id), *signal);
    signal->value_type = type == 1 ? DbcValueType::kFloat32 : DbcValueType::kFloat64;
  }

  DbcReader reader_;
  DbcDatabase database_;
  DbcMessageIndex index_;
  DbcAttributes attributes_;
  DbcValueTables value_tables_;
  DbcNotes notes_;
  std::vector<int> message_lines_;
  Context context_ = Context::kNoMessage;
  std::string first_problem_;
  std::size_t more_warnings_ = 0;
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
