// Input as a DBC file, whose signals decode and encode payloads of every length.

#include "nilio/drivers/can/dbc/dbc.hpp"

#include "tests/fuzz/fuzz_support.hpp"

#include <algorithm>
#include <array>
#include <string_view>

namespace nilio::fuzz {
namespace {

void check_signal(const drivers::DbcMessage& message, const drivers::DbcSignal& signal) {
  std::array<std::uint8_t, 64> payload{};
  for (std::size_t i = 0; i < payload.size(); ++i) payload[i] = static_cast<std::uint8_t>(37 * i + 11);
  const std::size_t needed = drivers::required_length(signal);
  for (const std::size_t length : {std::size_t{0}, std::size_t{1}, std::size_t{8}, payload.size()}) {
    const std::span<std::uint8_t> data = std::span(payload).first(length);
    const auto raw = drivers::decode_raw(signal, data);
    require(raw.has_value() == (length >= needed), "a signal decodes when the payload is long enough");
    const auto physical = drivers::decode_physical(signal, data);
    require(physical.has_value() == raw.has_value(), "raw and physical values come together");
    const bool selected = drivers::is_selected(message, signal, data);
    require(selected || signal.multiplexed, "what is not multiplexed is always selected");
    require(drivers::decode_physical(message, signal, data).has_value() == (selected && physical.has_value()),
            "a signal has a value in the frames that hold it");
    if (!physical || !drivers::encode_physical(signal, *physical, data)) continue;
    require(drivers::decode_raw(signal, data).has_value(), "what was encoded decodes");
  }
}

}  // namespace
}  // namespace nilio::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto database = nilio::drivers::parse_dbc(text, "fuzz.dbc");
  if (!database) {
    nilio::fuzz::require(database.error().message.find("fuzz.dbc") != std::string::npos,
                         "errors name the file");
    return 0;
  }
  for (const nilio::drivers::DbcMessage& message : database->messages) {
    for (const nilio::drivers::DbcSignal& signal : message.signals)
      nilio::fuzz::check_signal(message, signal);
  }
  return 0;
}
