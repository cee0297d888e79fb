// Input as packets in any order and state, assembled into scans.

#include "nilio/drivers/velodyne/decoder.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "tests/fuzz/fuzz_support.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

namespace nilio::fuzz {
namespace {

constexpr std::size_t kFiringsPerPacket = drivers::kBlocksPerPacket * drivers::kEntriesPerBlock;
/// Limits the run time of one input.
constexpr std::uint64_t kMostPackets = 80;

class PacketFuzz {
 public:
  explicit PacketFuzz(ByteReader input)
      : input_(input),
        sensor_(drivers::make_velodyne_sensor(
            drivers::velodyne_models()[input_.u8() % drivers::kVelodyneModelCount])) {
    drivers::ScanAssemblerConfig config;
    config.time_source = static_cast<drivers::TimeSource>(input_.u8() % 3);
    const std::uint8_t mode = input_.u8();
    layout_ = &sensor_.layouts[mode % sensor_.layouts.size()];
    if (mode >= 128) config.return_mode = layout_->mode;
    config.returns = static_cast<drivers::ReturnChoice>(input_.u8() % 3);
    config.cut_azimuth_deg = input_.u8() * (360.0 / 256.0);
    config.min_coverage = input_.u8() / 256.0;
    assembler_.emplace(sensor_, config);
  }

  void run() {
    while (!input_.empty() && fed_ < kMostPackets) {
      switch (static_cast<PacketRecord>(input_.u8() % 4)) {
        case PacketRecord::kRaw:
          feed_raw();
          break;
        case PacketRecord::kTurn:
          feed_turn();
          break;
        case PacketRecord::kAgain:
          feed_again();
          break;
        case PacketRecord::kClock:
          sensor_us_ = input_.u32();
          host_ns_ += std::int64_t{input_.u32()} * 1000;
          break;
      }
    }
    if (assembler_->finish()) check_scan();
    check_counters();
  }

 private:
  void feed_raw() {
    host_ns_ += std::int64_t{input_.u16()} * 1000;
    const auto bytes = input_.take(input_.u16() % 2048);
    packet_.truncated = bytes.size() > packet_.data.size();
    packet_.size = static_cast<std::uint16_t>(std::min(bytes.size(), packet_.data.size()));
    std::copy_n(bytes.begin(), packet_.size, packet_.data.begin());
    feed();
  }

  void feed_turn() {
    const std::size_t count = input_.u8();
    const std::uint16_t advance = input_.u16();
    const auto clock_error = static_cast<std::int16_t>(input_.u16());
    for (std::size_t i = 0; i < count && fed_ < kMostPackets; ++i) {
      drivers::VelodyneDataPacket data;
      for (std::size_t b = 0; b < drivers::kBlocksPerPacket; ++b) {
        data.blocks[b].flag = layout_->block_flags[b];
        data.blocks[b].azimuth = azimuth_;
        for (auto& entry : data.blocks[b].entries)
          entry = {static_cast<std::uint16_t>(5000 + azimuth_ / 4), 9};
        if ((b + 1) % layout_->blocks_per_azimuth == 0) {
          azimuth_ = static_cast<std::uint16_t>((azimuth_ + advance) % drivers::kAzimuthModulus);
        }
      }
      data.timestamp_us = sensor_us_;
      data.factory_byte_1 = layout_->return_mode_byte;
      data.factory_byte_2 = sensor_.product_byte;
      const auto bytes = drivers::encode(data);
      packet_.truncated = false;
      packet_.size = static_cast<std::uint16_t>(bytes.size());
      std::copy(bytes.begin(), bytes.end(), packet_.data.begin());
      const std::int64_t period_us = layout_->packet_period_ns / 1000;
      sensor_us_ = static_cast<std::uint32_t>((sensor_us_ + period_us + clock_error) % 3'600'000'000);
      host_ns_ += layout_->packet_period_ns;
      feed();
    }
  }

  void feed_again() {
    packet_.data[input_.u16() % packet_.data.size()] = input_.u8();
    feed();
  }

  void feed() {
    packet_.stamp.ns = host_ns_;
    packet_.received_ns = host_ns_;
    const bool is_position = packet_.size == drivers::kPositionPacketSize && !packet_.truncated;
    ++(is_position ? position_packets_ : fed_);
    if (assembler_->add(packet_)) check_scan();
  }

  void check_scan() {
    assembler_->take_scan(scan_);
    const drivers::ScanAssemblerStats& stats = assembler_->stats();
    require(scan_.sequence + 1 == stats.scans && scan_.sequence == taken_++, "scans are numbered one by one");
    require(scan_.start <= scan_.end, "a scan does not end before it begins");
    require(scan_.coverage_deg >= 0.0F && scan_.coverage_deg <= 360.0F, "coverage is 0 to 360 degrees");
    require(scan_.points.size() <= fed_ * kFiringsPerPacket, "no more points than firings");
    // The swapped-in buffers have their final size by the third scan.
    if (taken_ > 2) require(scan_.points.capacity() == point_capacity_, "point buffers do not grow");
    point_capacity_ = scan_.points.capacity();
    const std::int64_t length_ns = (scan_.end - scan_.start).ns;
    for (const core::Point& point : scan_.points) {
      require(std::isfinite(point.x) && std::isfinite(point.y) && std::isfinite(point.z),
              "points are finite");
      require(point.time_offset_ns >= 0 && point.time_offset_ns <= length_ns, "points lie within their scan");
      require(point.ring < sensor_.lasers.size(), "rings are those of the sensor");
    }
    points_taken_ += scan_.points.size();
    require(taken_ == 1 || scan_.start > last_end_, "time never goes back, whatever the clocks do");
    last_end_ = scan_.end;
  }

  void check_counters() const {
    const drivers::ScanAssemblerStats& stats = assembler_->stats();
    require(stats.packets + stats.bad_length == fed_, "every packet is counted once");
    require(stats.position_packets == position_packets_, "every position packet is counted once");
    require(stats.duplicate_packets + stats.late_packets <= stats.packets, "no packet is counted twice");
    require(stats.firings == stats.firings_in_scans + stats.firings_discarded + stats.firings_bad +
                                 stats.firings_late + assembler_->open_firings(),
            "every firing is in one scan or counted");
    require(stats.points + stats.points_out_of_range <= stats.packets * kFiringsPerPacket,
            "no return is counted twice");
    require(points_taken_ <= stats.points, "no point is in two scans");
    require(stats.scans == taken_, "every scan was handed out");
  }

  ByteReader input_;
  drivers::VelodyneSensor sensor_;
  const drivers::PacketLayout* layout_ = nullptr;
  std::optional<drivers::ScanAssembler> assembler_;
  drivers::Packet packet_;
  core::Scan scan_;
  std::int64_t host_ns_ = 1'700'000'000'000'000'000;
  /// 800 s past the hour, as the host's clock.
  std::uint32_t sensor_us_ = 800'000'000;
  std::uint16_t azimuth_ = 0;
  std::uint64_t fed_ = 0;
  std::uint64_t position_packets_ = 0;
  std::uint64_t taken_ = 0;
  std::uint64_t points_taken_ = 0;
  std::size_t point_capacity_ = 0;
  core::Time last_end_;
};

}  // namespace
}  // namespace nilio::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  nilio::fuzz::PacketFuzz(nilio::fuzz::ByteReader({data, size})).run();
  return 0;
}
