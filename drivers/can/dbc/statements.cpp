#include "drivers/can/dbc/statements.hpp"

#include <algorithm>
#include <array>
#include <string_view>

namespace nilio::drivers {
namespace {

constexpr std::string_view kFrameFormat = "VFrameFormat";
constexpr std::string_view kCycleTime = "GenMsgCycleTime";

bool is_used(std::string_view attribute) { return attribute == kFrameFormat || attribute == kCycleTime; }

/// Default names of the frame formats 0 to 15 in Vector's tools; most files repeat them in BA_DEF_.
constexpr std::array<std::string_view, 16> kFrameFormats{
    "StandardCAN", "ExtendedCAN", "reserved",       "J1939PG",       "reserved", "reserved",
    "reserved",    "reserved",    "reserved",       "reserved",      "reserved", "reserved",
    "reserved",    "reserved",    "StandardCAN_FD", "ExtendedCAN_FD"};

/// Reads pairs of number and text from `begin` on; false for any other token.
bool read_value_names(const std::vector<DbcToken>& statement, std::size_t begin,
                      std::vector<DbcValueName>& values) {
  for (std::size_t i = begin; i < statement.size(); i += 2) {
    DbcValueName value;
    if (i + 1 >= statement.size() || statement[i + 1].kind != DbcTokenKind::kString) return false;
    if (!parse_dbc_number(statement[i], value.raw)) return false;
    value.name = to_utf8(statement[i + 1].text);
    values.push_back(std::move(value));
  }
  return true;
}

}  // namespace

DbcMessage* DbcMessageIndex::find(DbcDatabase& database, std::uint32_t file_id) const {
  const auto found = indices_.find(file_id);
  return found == indices_.end() ? nullptr : &database.messages[found->second];
}

DbcSignal* DbcMessageIndex::find(DbcDatabase& database, std::uint32_t file_id,
                                 std::string_view signal) const {
  DbcMessage* message = find(database, file_id);
  if (message == nullptr) return nullptr;
  for (DbcSignal& candidate : message->signals) {
    if (candidate.name == signal) return &candidate;
  }
  return nullptr;
}

DbcAttributes::Value DbcAttributes::value_of(const DbcToken& token) {
  Value value;
  value.is_number = parse_dbc_number(token, value.number);
  value.text = to_utf8(token.text);
  return value;
}

void DbcAttributes::define(const std::vector<DbcToken>& statement) {
  const auto name = std::find_if(statement.begin(), statement.end(),
                                 [](const DbcToken& t) { return t.kind == DbcTokenKind::kString; });
  if (name == statement.end() || name->text != kFrameFormat) return;
  frame_formats_.clear();
  for (auto token = name + 1; token != statement.end(); ++token) {
    if (token->kind == DbcTokenKind::kString) frame_formats_.emplace_back(token->text);
  }
}

void DbcAttributes::set_default(const std::vector<DbcToken>& statement) {
  if (statement.size() != 2 || !is_used(statement[0].text)) return;
  defaults_[std::string(statement[0].text)] = value_of(statement[1]);
}

void DbcAttributes::assign(const std::vector<DbcToken>& statement) {
  std::uint32_t id = 0;
  if (statement.size() != 4 || !is_used(statement[0].text) || !statement[1].is("BO_")) return;
  if (parse_dbc_number(statement[2], id))
    assigned_[std::string(statement[0].text)][id] = value_of(statement[3]);
}

std::string DbcAttributes::frame_format_of(const Value& value) const {
  if (!value.is_number) return value.text;
  const std::size_t count = frame_formats_.empty() ? kFrameFormats.size() : frame_formats_.size();
  if (value.number < 0.0 || value.number >= static_cast<double>(count)) return {};
  const auto index = static_cast<std::size_t>(value.number);
  return frame_formats_.empty() ? std::string(kFrameFormats[index]) : frame_formats_[index];
}

void DbcAttributes::apply_frame_format(DbcMessage& message, const Value& value) const {
  const std::string format = frame_format_of(value);
  message.flexible_data_rate = format.ends_with("_FD");
  // Only 29-bit identifiers have room for a group and an address.
  message.j1939 = format == "J1939PG" && message.extended;
}

void DbcAttributes::apply_cycle_time(DbcMessage& message, const Value& value) {
  message.cycle_ms = value.is_number && value.number > 0.0 ? value.number : 0.0;
}

void DbcAttributes::apply(DbcDatabase& database, const DbcMessageIndex& index) const {
  if (const auto format = defaults_.find(kFrameFormat); format != defaults_.end()) {
    for (DbcMessage& message : database.messages) apply_frame_format(message, format->second);
  }
  if (const auto time = defaults_.find(kCycleTime); time != defaults_.end()) {
    for (DbcMessage& message : database.messages) apply_cycle_time(message, time->second);
  }
  for (const auto& [name, values] : assigned_) {
    for (const auto& [id, value] : values) {
      DbcMessage* message = index.find(database, id);
      if (message == nullptr) continue;
      if (name == kFrameFormat) {
        apply_frame_format(*message, value);
      } else {
        apply_cycle_time(*message, value);
      }
    }
  }
}

void DbcValueTables::define(const std::vector<DbcToken>& statement, DbcNotes& notes) {
  std::vector<DbcValueName> values;
  if (statement.empty()) return;
  if (!read_value_names(statement, 1, values)) {
    notes.add(statement[0].line, "value table (VAL_TABLE_) that is no list of numbers and texts, not used");
    return;
  }
  tables_[std::string(statement[0].text)] = std::move(values);
}

void DbcValueTables::assign(const std::vector<DbcToken>& statement, DbcDatabase& database,
                            const DbcMessageIndex& index, DbcNotes& notes) const {
  std::uint32_t id = 0;
  if (statement.size() < 2) return;
  if (!parse_dbc_number(statement[0], id)) {
    return notes.add(statement[0].line, "values (VAL_) of an environment variable, not used");
  }
  DbcSignal* signal = index.find(database, id, statement[1].text);
  if (signal == nullptr)
    return notes.add(statement[0].line, "values (VAL_) of a signal that is not in the file");
  if (const auto table = tables_.find(statement.back().text);
      statement.size() == 3 && table != tables_.end()) {
    signal->values = table->second;
    return;
  }
  std::vector<DbcValueName> values;
  if (!read_value_names(statement, 2, values)) {
    return notes.add(statement[0].line, "values (VAL_) that are no list of numbers and texts, not used");
  }
  signal->values = std::move(values);
}

void read_comment(const std::vector<DbcToken>& statement, DbcDatabase& database, const DbcMessageIndex& index,
                  DbcNotes& notes) {
  if (statement.size() < 3 || (!statement[0].is("BO_") && !statement[0].is("SG_"))) return;
  const bool of_signal = statement[0].is("SG_");
  std::uint32_t id = 0;
  const bool valid = statement.size() == (of_signal ? 4U : 3U) && parse_dbc_number(statement[1], id) &&
                     statement.back().kind == DbcTokenKind::kString;
  if (!valid) return notes.add(statement[0].line, "comment (CM_) that is not understood");
  if (of_signal) {
    if (DbcSignal* signal = index.find(database, id, statement[2].text)) {
      signal->comment = to_utf8(statement.back().text);
    }
  } else if (DbcMessage* message = index.find(database, id)) {
    message->comment = to_utf8(statement.back().text);
  }
}

}  // namespace nilio::drivers
