#include "drivers/can/dbc/statements.hpp"

#include <algorithm>
#include <linux/can.h>
#include <set>
#include <string_view>

namespace nilio::drivers {
namespace {

/// Limit of nested multiplexers; real files have two or three levels.
constexpr std::size_t kDeepest = 16;
constexpr std::size_t kLargestFrame = 64;

/// Parses "3-7", both ends included.
bool parse_range(const DbcToken& token, DbcRange& range) {
  const std::size_t dash = token.text.find('-');
  if (token.kind != DbcTokenKind::kWord || dash == std::string_view::npos) return false;
  DbcToken first = token;
  DbcToken last = token;
  first.text = token.text.substr(0, dash);
  last.text = token.text.substr(dash + 1);
  return parse_dbc_number(first, range.first) && parse_dbc_number(last, range.last) &&
         range.first <= range.last;
}

std::optional<std::size_t> index_of(const DbcMessage& message, std::string_view signal) {
  for (std::size_t i = 0; i < message.signals.size(); ++i) {
    if (message.signals[i].name == signal) return i;
  }
  return std::nullopt;
}

bool leads_to_root(const DbcMessage& message, const DbcSignal& signal) {
  const DbcSignal* at = &signal;
  for (std::size_t depth = 0; depth < kDeepest; ++depth) {
    if (!at->selector) return true;
    at = &message.signals[*at->selector];
  }
  return false;
}

/// Index of the signal marked M.
std::optional<std::size_t> root_of(const DbcMessage& message) {
  for (std::size_t i = 0; i < message.signals.size(); ++i) {
    if (message.signals[i].multiplexer && !message.signals[i].multiplexed) return i;
  }
  return std::nullopt;
}

}  // namespace

void read_extended_multiplexing(const DbcToken& keyword, const std::vector<DbcToken>& statement,
                                DbcDatabase& database, const DbcMessageIndex& index, DbcReader& reader) {
  std::uint32_t id = 0;
  if (statement.size() < 4) {
    return reader.fail(keyword, "expected message, signal, multiplexer and ranges after SG_MUL_VAL_");
  }
  if (!parse_dbc_number(statement[0], id)) {
    return reader.fail_expected(statement[0], "the message's identifier");
  }
  DbcMessage* message = index.find(database, id);
  if (message == nullptr) return reader.fail_expected(statement[0], "the identifier of a message above");
  const auto signal = index_of(*message, statement[1].text);
  if (!signal) return reader.fail_expected(statement[1], "a signal of message " + quoted(message->name));
  DbcSignal& target = message->signals[*signal];
  target.multiplexed = true;
  target.selector.reset();
  target.selected_by.clear();
  const auto selector = index_of(*message, statement[2].text);
  if (!selector) return reader.fail_expected(statement[2], "a signal of message " + quoted(message->name));
  std::vector<DbcRange> ranges;
  for (std::size_t i = 3; i < statement.size(); ++i) {
    if (statement[i].is(",")) continue;
    if (!parse_range(statement[i], ranges.emplace_back())) {
      return reader.fail_expected(statement[i], "a range of the multiplexer's values, as 3-7");
    }
  }
  target.selector = selector;
  target.selected_by = std::move(ranges);
}

std::vector<std::string> resolve_multiplexers(DbcDatabase& database) {
  std::vector<std::string> problems;
  for (DbcMessage& message : database.messages) {
    const std::optional<std::size_t> root = root_of(message);
    for (DbcSignal& signal : message.signals) {
      if (!signal.multiplexed) continue;
      if (!signal.selector) signal.selector = root;
    }
    std::vector<DbcSignal*> circular;
    for (DbcSignal& signal : message.signals) {
      if (!leads_to_root(message, signal)) circular.push_back(&signal);
    }
    for (DbcSignal* signal : circular) {
      signal->selector.reset();
      signal->selected_by.clear();
      problems.push_back(database.path + ": the multiplexers of signal " + quoted(signal->name) +
                         " of message " + quoted(message.name) +
                         " select each other (SG_MUL_VAL_): the signal is in no frame - correct the file");
    }
  }
  return problems;
}

void remove_signal(DbcMessage& message, const DbcSignal& signal) {
  const auto index = static_cast<std::size_t>(&signal - message.signals.data());
  message.signals.erase(message.signals.begin() + static_cast<std::ptrdiff_t>(index));
  for (DbcSignal& other : message.signals) {
    if (!other.selector || *other.selector < index) continue;
    if (*other.selector > index) {
      --*other.selector;
    } else {
      other.selector.reset();
      other.selected_by.clear();
    }
  }
}

void note_contradictions(const DbcMessage& message, int line, DbcNotes& notes) {
  const std::string name = "message " + quoted(message.name);
  if (!message.extended && message.id > CAN_SFF_MASK) {
    notes.add(line, name + " has the identifier " + std::to_string(message.id) +
                        ", which is too large for 11 bits and not marked as extended: no frame has it");
  }
  if (message.length > kLargestFrame) {
    notes.add(line, name + " has " + std::to_string(message.length) +
                        " bytes, more than a frame: messages sent in several frames are not put together");
  }
  std::set<std::string_view> names;
  for (const DbcSignal& signal : message.signals) {
    if (required_length(signal) > message.length) {
      notes.add(line, "signal " + quoted(signal.name) + " of " + name + " does not fit into its " +
                          std::to_string(message.length) + " bytes");
    }
    if (signal.multiplexed && !signal.selector) {
      notes.add(line, "signal " + quoted(signal.name) + " of " + name +
                          " is multiplexed, but the message has no multiplexer (M): it is in no frame");
    }
    if (!names.insert(signal.name).second) {
      notes.add(line, name + " has two signals " + quoted(signal.name) + ": the first is used");
    }
  }
}

}  // namespace nilio::drivers
