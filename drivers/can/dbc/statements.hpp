#pragma once

#include "nilio/drivers/can/dbc/dbc.hpp"

#include "drivers/can/dbc/reader.hpp"

#include <cstdint>
#include <map>
#include <string>
#include <unordered_map>
#include <vector>

namespace nilio::drivers {

inline constexpr std::uint32_t kDbcExtendedFlag = 0x80000000U;
inline constexpr std::uint32_t kDbcIdMask = 0x1FFFFFFFU;

/// Finds messages by the identifier as written in the file, with bit 31 for extended identifiers.
class DbcMessageIndex {
 public:
  /// False when the identifier exists already.
  bool add(std::uint32_t file_id, std::size_t index) { return indices_.emplace(file_id, index).second; }
  [[nodiscard]] DbcMessage* find(DbcDatabase& database, std::uint32_t file_id) const;
  [[nodiscard]] DbcSignal* find(DbcDatabase& database, std::uint32_t file_id, std::string_view signal) const;

 private:
  std::unordered_map<std::uint32_t, std::size_t> indices_;
};

/// Attributes of how frames are sent. A message without its own value has the default.
class DbcAttributes {
 public:
  /// BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN", ...
  void define(const std::vector<DbcToken>& statement);
  /// BA_DEF_DEF_ "name" value
  void set_default(const std::vector<DbcToken>& statement);
  /// BA_ "name" BO_ id value
  void assign(const std::vector<DbcToken>& statement);
  void apply(DbcDatabase& database, const DbcMessageIndex& index) const;

 private:
  struct Value {
    bool is_number = false;
    double number = 0.0;
    std::string text;
  };
  using Values = std::map<std::uint32_t, Value>;

  static Value value_of(const DbcToken& token);
  [[nodiscard]] std::string frame_format_of(const Value& value) const;
  void apply_frame_format(DbcMessage& message, const Value& value) const;
  static void apply_cycle_time(DbcMessage& message, const Value& value);

  std::vector<std::string> frame_formats_;
  std::map<std::string, Value, std::less<>> defaults_;
  /// Values by attribute and message.
  std::map<std::string, Values, std::less<>> assigned_;
};

/// Named values: VAL_TABLE_ and VAL_.
class DbcValueTables {
 public:
  /// VAL_TABLE_ name 0 "zero" 1 "one"
  void define(const std::vector<DbcToken>& statement, DbcNotes& notes);
  /// VAL_ id signal 0 "zero", or VAL_ id signal table
  void assign(const std::vector<DbcToken>& statement, DbcDatabase& database, const DbcMessageIndex& index,
              DbcNotes& notes) const;

 private:
  std::map<std::string, std::vector<DbcValueName>, std::less<>> tables_;
};

/// Reads CM_ BO_ id "text" and CM_ SG_ id signal "text"; comments on the file, nodes and variables are
/// ignored.
void read_comment(const std::vector<DbcToken>& statement, DbcDatabase& database, const DbcMessageIndex& index,
                  DbcNotes& notes);

/// Reads SG_MUL_VAL_ id signal multiplexer 0-3, 7-7. If the multiplexer or a range cannot be read, no frame
/// has the signal.
void read_extended_multiplexing(const DbcToken& keyword, const std::vector<DbcToken>& statement,
                                DbcDatabase& database, const DbcMessageIndex& index, DbcReader& reader);

/// Assigns the message's multiplexer to signals marked m3 without another one. Returns a text for each signal
/// whose multiplexers select each other; no frame has it.
std::vector<std::string> resolve_multiplexers(DbcDatabase& database);

/// Removes a signal of the message. No frame has the signals that it selects.
void remove_signal(DbcMessage& message, const DbcSignal& signal);

/// Notes contradictions in a readable message.
void note_contradictions(const DbcMessage& message, int line, DbcNotes& notes);

}  // namespace nilio::drivers
