#pragma once

#include "nilio/drivers/can/log/candump.hpp"

#include <cstdint>
#include <optional>
#include <string_view>

namespace nilio::drivers {

/// Reads Vector's ASC logs line by line. Channel 1 is interface can0, as asc2log has it. The file's date has
/// no time zone: it is taken as UTC; a date that is not understood counts from 1970.
class AscLog {
 public:
  /// True for the line that such logs begin with.
  static bool is_first_line(std::string_view line);

  enum class Kind { kFrame, kOther, kBroken };
  /// kOther: headers, comments and events that are no frames.
  Kind read(std::string_view line, CandumpLine& result);

 private:
  void read_date(std::string_view rest);
  bool read_classic(std::string_view rest, CandumpLine& result) const;
  bool read_flexible(std::string_view rest, CandumpLine& result) const;
  bool read_id(std::string_view word, CanFrame& frame) const;
  bool read_data(std::string_view rest, CanFrame& frame) const;

  int base_ = 16;
  bool times_are_steps_ = false;
  std::int64_t start_ns_ = 0;
  std::int64_t last_ns_ = 0;
};

}  // namespace nilio::drivers
