// Input as CAN frames of every preset: the decoder's counts add up, times increase, and no memory is
// allocated.

#include "nilio/drivers/capture/capture_reader.hpp"
#include "nilio/drivers/imu/decoder.hpp"

#include "tests/fuzz/fuzz_support.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <sanitizer/allocator_interface.h>
#include <string>
#include <utility>
#include <vector>

#include <pcap/dlt.h>

namespace nilio::fuzz {
namespace {

std::size_t allocations = 0;

void count_allocation(const volatile void* /*memory*/, std::size_t /*size*/) { ++allocations; }
void ignore_free(const volatile void* /*memory*/) {}

const std::vector<drivers::ImuPreset>& presets() {
  static const std::vector<drivers::ImuPreset> all = [] {
    std::vector<drivers::ImuPreset> made;
    for (const std::string& name : drivers::imu_preset_names()) made.push_back(*drivers::imu_preset(name));
    const int installed = __sanitizer_install_malloc_and_free_hooks(count_allocation, ignore_free);
    require(installed > 0, "allocations can be counted");
    return made;
  }();
  return all;
}

std::optional<core::ImuSample> add(drivers::ImuDecoder& decoder, const drivers::CanFrame& frame) {
  const std::size_t before = allocations;
  const std::optional<core::ImuSample> sample = decoder.add(frame);
  require(allocations == before, "adding a frame does not allocate");
  return sample;
}

/// Advances the stamp by a value from the input, mostly small.
std::int64_t step_ns(ByteReader& input) {
  const std::uint8_t kind = input.u8();
  if (kind < 0xF0) return kind * std::int64_t{100'000};
  const std::int64_t large = static_cast<std::int32_t>(input.u32());
  return kind < 0xF8 ? large : large * 1'000'000'000;
}

drivers::CanFrame read_frame(ByteReader& input, const drivers::DbcDatabase& database,
                             std::int64_t& stamp_ns) {
  const std::uint8_t head = input.u8();
  const drivers::DbcMessage& message = database.messages[head % database.messages.size()];
  drivers::CanFrame frame;
  frame.id = message.id;
  frame.extended = message.extended;
  if (head >= 0xF0) frame.id ^= input.u8();
  frame.remote = head == 0xEF;
  frame.error = head == 0xEE;
  frame.length = head >= 0xE0 ? input.u8() : static_cast<std::uint8_t>(message.length);
  const auto data = input.take(std::min<std::size_t>(frame.length, frame.data.size()));
  std::copy(data.begin(), data.end(), frame.data.begin());
  // Sums of stamps stay within 64 bits, as in the sources.
  stamp_ns = std::clamp<std::int64_t>(stamp_ns + step_ns(input), -1'000'000'000, 5'000'000'000'000'000'000);
  frame.stamp.ns = stamp_ns;
  return frame;
}

void check_sample(const core::ImuSample& sample, const drivers::ImuMapping& mapping) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    require(std::isnan(sample.angular_velocity[axis]) == mapping.angular_velocity[axis].message.empty(),
            "exactly the missing axes are not numbers");
    require(std::isnan(sample.linear_acceleration[axis]) == mapping.linear_acceleration[axis].message.empty(),
            "exactly the missing axes are not numbers");
  }
}

void decode(ByteReader input) {
  const drivers::ImuPreset& preset = presets()[input.u8() % presets().size()];
  auto decoder = drivers::ImuDecoder::create_partial(preset.mapping, preset.database);
  require(decoder.ok(), "every preset can be decoded");
  require(allocations > 0, "allocations are counted");
  std::int64_t stamp_ns = 1'700'000'000'000'000'000;
  std::uint64_t added = 0;
  std::uint64_t samples = 0;
  core::Time last{-1};
  while (!input.empty()) {
    const std::optional<core::ImuSample> sample = add(*decoder, read_frame(input, preset.database, stamp_ns));
    ++added;
    if (!sample) continue;
    ++samples;
    require(sample->stamp > last, "time goes forward");
    last = sample->stamp;
    check_sample(*sample, preset.mapping);
  }
  const drivers::ImuDecoderStats& stats = decoder->stats();
  require(stats.samples == samples, "every sample is counted");
  require(stats.frames + stats.other_frames + stats.other_sources <= added, "frames are counted once");
  require(stats.saturated <= samples && stats.frozen <= samples && stats.device_stamped <= samples &&
              stats.gaps <= samples,
          "what is counted of samples is not more than those");
  require(stats.longest_gap.ns >= 0, "gaps are not negative");
}

void find_frames(std::span<const std::uint8_t> bytes) {
  for (const int link_type : {DLT_CAN_SOCKETCAN, DLT_LINUX_SLL, DLT_LINUX_SLL2, DLT_EN10MB}) {
    for (const bool big_endian : {false, true}) {
      const drivers::CapturedCan can = drivers::find_can_frame(link_type, bytes, big_endian);
      if (can.kind != drivers::CapturedCan::Kind::kCan) continue;
      require(can.frame.length <= (can.frame.flexible_data_rate ? 64 : 8), "frames have lengths that exist");
    }
  }
}

}  // namespace
}  // namespace nilio::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  nilio::fuzz::find_frames({data, size});
  nilio::fuzz::decode(nilio::fuzz::ByteReader({data, size}));
  return 0;
}
