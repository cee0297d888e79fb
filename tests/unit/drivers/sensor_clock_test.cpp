#include "drivers/velodyne/clock/sensor_clock.hpp"

#include "drivers/common/clock_fit.hpp"
#include "tests/support/drivers_support.hpp"

#include <cmath>
#include <random>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using nilio::tests::kEpochNs;
using nilio::tests::TurningSensor;

TEST_CASE("offset and drift of a clock are estimated under one-sided jitter", "[sensor_clock]") {
  std::mt19937 random(3);
  std::exponential_distribution<double> delay_us(1.0 / 300.0);
  for (const double drift_ppm : {-58.0, 0.0, 20.0}) {
    ClockFit fit;
    std::int64_t sensor_ns = 0;
    for (; sensor_ns < 90'000'000'000; sensor_ns += 1'327'000) {
      const auto true_ns =
          5'000'000'000 + static_cast<std::int64_t>(drift_ppm * 1e-6 * static_cast<double>(sensor_ns));
      fit.observe(sensor_ns, true_ns + std::llround(1e3 * delay_us(random)));
    }
    const auto expected_ns =
        5'000'000'000 + static_cast<std::int64_t>(drift_ppm * 1e-6 * static_cast<double>(sensor_ns));
    INFO("drift " << drift_ppm << " ppm: " << fit.drift() * 1e6);
    CHECK(std::abs(fit.drift() * 1e6 - drift_ppm) < 0.2);
    CHECK(std::abs(fit.offset_at(sensor_ns) - expected_ns) < 10'000);
  }
}

TEST_CASE("before the drift is observable the minimum difference is the offset", "[sensor_clock]") {
  ClockFit fit;
  CHECK(fit.empty());
  fit.observe(0, 900);
  fit.observe(1'000'000, 700);
  fit.observe(2'000'000, 800);
  CHECK_FALSE(fit.empty());
  CHECK(fit.offset_at(3'000'000) == 700);
  CHECK(fit.drift() == 0.0);
}

TEST_CASE("scan times of a drifting sensor follow the host's clock without jitter or jumps",
          "[sensor_clock]") {
  // 20 parts per million fast, 3 s ahead, with a network delay of up to a few milliseconds.
  const TurningSensor source{.sensor = make_velodyne_sensor(VelodyneModel::kVlp16),
                             .start_azimuth_deg = 180.0};
  constexpr double kFast = 20e-6;
  std::mt19937 random(5);
  std::exponential_distribution<double> delay_us(1.0 / 300.0);
  ScanAssembler assembler(source.sensor, {});
  core::Scan scan;
  double largest_error_us = 0.0;
  double largest_step_error_us = 0.0;
  std::int64_t last_start_ns = 0;
  for (std::size_t i = 0; i < 45'000; ++i) {
    Packet packet = source.packet(i, std::llround(1e3 * delay_us(random)));
    const auto since_start = static_cast<double>(source.packet_time_ns(i) - source.start_ns);
    VelodyneDataPacket data = source.data(i);
    const std::int64_t sensor_ns =
        source.packet_time_ns(i) + 3'000'000'000 + static_cast<std::int64_t>(kFast * since_start);
    data.timestamp_us = static_cast<std::uint32_t>(sensor_ns / 1000 % 3'600'000'000);
    const auto bytes = encode(data);
    std::copy(bytes.begin(), bytes.end(), packet.data.begin());
    if (!assembler.add(packet)) continue;
    assembler.take_scan(scan);
    CHECK(scan.clock_source == core::ClockSource::kFreeRunning);
    // Scans start at the cut, every 0.1 s to within one azimuth step.
    const auto revolution = static_cast<double>(scan.start.ns - source.start_ns) / 1e8;
    const double error_us = 1e5 * (revolution - std::floor(revolution + 0.01));
    if (scan.sequence >= 100) {
      largest_error_us = std::max(largest_error_us, std::abs(error_us));
      const double step_us = static_cast<double>(scan.start.ns - last_start_ns) * 1e-3;
      largest_step_error_us = std::max(largest_step_error_us, std::abs(step_us - 1e5));
    }
    REQUIRE(scan.start.ns > last_start_ns);
    last_start_ns = scan.start.ns;
  }
  // An azimuth step lasts 111 us, the maximum delay of the cut.
  CHECK(largest_error_us < 111.0 + 20.0);
  CHECK(largest_step_error_us < 111.0 + 20.0);
  CHECK(assembler.status().clock_drift_ppm == Approx(-20.0).margin(1.0));
  CHECK(assembler.status().clock_offset_s == Approx(-3.0).margin(2e-3));
}

TEST_CASE("the sensor's GPS decides the hour when the host's clock is hours off", "[sensor_clock]") {
  SensorClock clock(TimeSource::kSensor, true);
  clock.set_packet_period(1'327'104);
  const std::int64_t true_ns = kEpochNs;
  const core::Time host{true_ns - 7 * 3'600'000'000'000};
  clock.on_gps_report({.pulse_locked = true, .utc = core::Time{true_ns - 900'000'000}}, host);
  const auto timestamp_us = static_cast<std::uint32_t>(true_ns / 1000 % 3'600'000'000);
  const PacketArrival arrival = clock.arrive(timestamp_us, 0, host, 0);
  CHECK(arrival.line_ns == true_ns);
  CHECK(clock.source() == core::ClockSource::kPpsLocked);

  // The first position packet arrives after the first data packets.
  SensorClock late(TimeSource::kSensor, true);
  late.set_packet_period(1'327'104);
  CHECK(late.arrive(timestamp_us, 0, host, 0).line_ns == host.ns);
  late.on_gps_report({.pulse_locked = true, .utc = core::Time{true_ns - 900'000'000}}, host);
  const core::Time next{host.ns + 1'327'000};
  CHECK(late.arrive(timestamp_us + 1327, 50, next, 0).order == PacketOrder::kJump);
  CHECK(late.restart(timestamp_us + 1327, 50, next) == true_ns + 1'327'000);
  const core::Time after{host.ns + 2'654'000};
  CHECK(late.arrive(timestamp_us + 2654, 100, after, 0).order == PacketOrder::kNext);
}

TEST_CASE("the time source is reported according to the telemetry", "[sensor_clock]") {
  const core::Time host{kEpochNs + 2'000'000};
  const auto timestamp_us = static_cast<std::uint32_t>(kEpochNs / 1000 % 3'600'000'000);
  const auto source_after = [&](TimeSource wanted, std::uint32_t stamp_us,
                                const std::optional<GpsReport>& report, bool has_ptp = false) {
    SensorClock clock(wanted, true, has_ptp);
    clock.set_packet_period(1'327'104);
    if (report) clock.on_gps_report(*report, host);
    clock.arrive(stamp_us, 0, host, 0);
    return clock.source();
  };
  const GpsReport locked{.pulse_locked = true, .utc = host};
  const GpsReport nmea{.pulse_locked = false, .utc = host};
  const GpsReport nothing{};
  CHECK(source_after(TimeSource::kAuto, timestamp_us, locked) == core::ClockSource::kPpsLocked);
  CHECK(source_after(TimeSource::kAuto, timestamp_us, nmea) == core::ClockSource::kNmeaOnly);
  // Agreement with the host is no proof of PTP, which most models do not have.
  CHECK(source_after(TimeSource::kAuto, timestamp_us, nothing) == core::ClockSource::kHostAgreement);
  CHECK(source_after(TimeSource::kAuto, timestamp_us, nothing, true) == core::ClockSource::kPtp);
  CHECK(source_after(TimeSource::kAuto, timestamp_us + 500'000'000, nothing) ==
        core::ClockSource::kFreeRunning);
  CHECK(source_after(TimeSource::kAuto, timestamp_us, std::nullopt) == core::ClockSource::kHostAgreement);
  CHECK(source_after(TimeSource::kHost, timestamp_us, locked) == core::ClockSource::kHost);
}

TEST_CASE("a sensor without a clock gets even times from jittering receive times", "[sensor_clock]") {
  const VelodyneSensor sensor = make_velodyne_sensor(VelodyneModel::kHdl64eS1);
  TurningSensor source{.sensor = sensor, .start_azimuth_deg = 180.0};
  std::mt19937 random(5);
  std::uniform_real_distribution<double> delay_us(0.0, 200.0);
  ScanAssembler assembler(sensor, {});
  core::Scan scan;
  std::int64_t last_end_ns = 0;
  int scans = 0;
  for (std::size_t i = 0; i < 6'000; ++i) {
    VelodyneDataPacket data = source.data(i);
    data.timestamp_us = static_cast<std::uint32_t>(random());
    Packet packet = TurningSensor::wrap(data);
    packet.stamp = source.packet(i, std::llround(1e3 * delay_us(random))).stamp;
    if (!assembler.add(packet)) continue;
    assembler.take_scan(scan);
    ++scans;
    CHECK(scan.clock_source == core::ClockSource::kHost);
    CHECK(scan.start.ns > last_end_ns);
    CHECK((scan.end - scan.start).seconds() == Approx(0.1).margin(5e-4));
    last_end_ns = scan.end.ns;
  }
  CHECK(scans >= 20);
  CHECK(assembler.stats().time_jumps + assembler.stats().lost_packets + assembler.stats().duplicate_packets ==
        0);
}

TEST_CASE("only a VLS-128 can report PTP", "[sensor_clock]") {
  for (const VelodyneModel model : velodyne_models()) {
    const TurningSensor source{.sensor = make_velodyne_sensor(model)};
    ScanAssembler assembler(source.sensor, {});
    for (std::size_t i = 0; i < 20; ++i) assembler.add(source.packet(i));
    const core::ClockSource expected = model == VelodyneModel::kVls128 ? core::ClockSource::kPtp
                                       : source.sensor.has_clock       ? core::ClockSource::kHostAgreement
                                                                       : core::ClockSource::kHost;
    INFO(source.sensor.name);
    CHECK(assembler.status().clock_source == expected);
  }
}

namespace {

/// Clock that is set after three seconds, and by how much.
struct ClockStep {
  std::int64_t sensor_ns = 0;
  std::int64_t host_ns = 0;
};

struct SteppedRun {
  ScanAssemblerStats stats;
  /// Published minus true time of the scans that end a second after the step or later.
  double least_error_s = 1e9;
  double most_error_s = -1e9;
  /// Sum of Scan::clock_step.
  double clock_step_s = 0.0;
};

/// A VLP-16 of which every 50th packet is lost, with network jitter; the published times never go back.
SteppedRun run_with_step(std::int64_t ahead_ns, TimeSource time_source, const ClockStep& step) {
  TurningSensor source{.sensor = make_velodyne_sensor(VelodyneModel::kVlp16), .sensor_ahead_ns = ahead_ns};
  std::mt19937 random(11);
  std::exponential_distribution<double> delay_us(1.0 / 300.0);
  ScanAssembler assembler(source.sensor, {.time_source = time_source});
  SteppedRun result;
  core::Scan scan;
  core::Time last_end{0};
  constexpr std::size_t kPackets = 6000;
  constexpr std::size_t kStepAt = 2260;
  for (std::size_t i = 0; i < kPackets; ++i) {
    if (i == kStepAt) source.sensor_ahead_ns += step.sensor_ns;
    if (i % 50 == 7) continue;
    Packet packet = source.packet(i, std::llround(1e3 * delay_us(random)));
    if (i >= kStepAt) packet.stamp.ns += step.host_ns;
    if (!assembler.add(packet)) continue;
    assembler.take_scan(scan);
    CHECK(scan.start > last_end);
    last_end = scan.end;
    result.clock_step_s += scan.clock_step.seconds();
    if (i < kStepAt + 754) continue;
    // The last firing of the packet that completed the scan is the scan's end to within a packet.
    const double error_s = static_cast<double>(scan.end.ns - source.packet_time_ns(i)) * 1e-9;
    result.least_error_s = std::min(result.least_error_s, error_s);
    result.most_error_s = std::max(result.most_error_s, error_s);
  }
  result.stats = assembler.stats();
  return result;
}

void check_error(const SteppedRun& run, double expected_s) {
  CHECK(run.least_error_s == Approx(expected_s).margin(4e-3));
  CHECK(run.most_error_s == Approx(expected_s).margin(4e-3));
}

}  // namespace

TEST_CASE("a sensor's clock that is set is no packet loss, and stamps are right after a second",
          "[sensor_clock]") {
  for (const std::int64_t ahead_ns : {std::int64_t{0}, std::int64_t{1'234'000'000'000}}) {
    for (const std::int64_t step_ms : {-1000, -300, -100, 100, 150, 300, 600, 1000, 2500}) {
      INFO("ahead " << ahead_ns << " ns, step " << step_ms << " ms");
      const SteppedRun run = run_with_step(ahead_ns, TimeSource::kAuto, {.sensor_ns = step_ms * 1'000'000});
      CHECK(run.stats.time_jumps == 1);
      CHECK(run.stats.host_clock_jumps == 0);
      CHECK(run.stats.damaged_stamps == 0);
      CHECK(run.stats.lost_packets == 120);
      CHECK(run.clock_step_s == 0.0);
      check_error(run, 0.0);
    }
  }
}

TEST_CASE("a host's clock that is set forward is followed within a second, one set back is not",
          "[sensor_clock]") {
  for (const std::int64_t ahead_ns : {std::int64_t{0}, std::int64_t{1'234'000'000'000}}) {
    for (const std::int64_t step_ms : {-1000, -300, -100, 100, 300, 600, 1000, 2500, 60'000}) {
      INFO("ahead " << ahead_ns << " ns, step " << step_ms << " ms");
      const SteppedRun run = run_with_step(ahead_ns, TimeSource::kAuto, {.host_ns = step_ms * 1'000'000});
      CHECK(run.stats.host_clock_jumps == 1);
      CHECK(run.stats.time_jumps == 0);
      CHECK(run.stats.lost_packets == 120);
      // Also where both clocks agreed before: the IMU's samples follow the host, too.
      const double ahead_s = step_ms > 0 ? static_cast<double>(step_ms) * 1e-3 : 0.0;
      check_error(run, ahead_s);
      CHECK(run.clock_step_s == Approx(ahead_s).margin(4e-3));
    }
  }
}

TEST_CASE("sensor time that is configured does not follow the host", "[sensor_clock]") {
  const SteppedRun run = run_with_step(0, TimeSource::kSensor, {.host_ns = 1'000'000'000});
  CHECK(run.stats.host_clock_jumps == 1);
  check_error(run, 0.0);
}

TEST_CASE("sensor time that is configured follows the sensor forward at once", "[sensor_clock]") {
  const SteppedRun run = run_with_step(0, TimeSource::kSensor, {.sensor_ns = 700'000'000});
  CHECK(run.stats.time_jumps == 1);
  check_error(run, 0.7);
}

TEST_CASE("a queue that drains within a second is no clock that was set", "[sensor_clock]") {
  const TurningSensor source{.sensor = make_velodyne_sensor(VelodyneModel::kVlp16)};
  for (const std::int64_t queue_ms : {60, 400, 900}) {
    ScanAssembler assembler(source.sensor, {});
    for (std::size_t i = 0; i < 6000; ++i) {
      Packet packet = source.packet(i, 50'000);
      // For a while nothing arrives, then everything at once.
      const std::int64_t held_until_ns = source.packet_time_ns(1500) + queue_ms * 1'000'000;
      if (i >= 1500) packet.stamp.ns = std::max(packet.stamp.ns, held_until_ns);
      assembler.add(packet);
    }
    INFO(queue_ms << " ms");
    CHECK(assembler.stats().host_clock_jumps + assembler.stats().time_jumps == 0);
    CHECK(assembler.stats().lost_packets + assembler.stats().damaged_stamps == 0);
  }
}

TEST_CASE("copies of packets without a time stamp are recognised", "[sensor_clock]") {
  const VelodyneSensor sensor = make_velodyne_sensor(VelodyneModel::kHdl64eS1);
  const TurningSensor source{.sensor = sensor};
  ScanAssembler assembler(sensor, {});
  for (std::size_t i = 0; i < 2000; ++i) {
    Packet packet = source.packet(i);
    std::fill_n(packet.data.begin() + 1200, 4, std::uint8_t{0});
    assembler.add(packet);
    assembler.add(packet);
  }
  CHECK(assembler.stats().duplicate_packets == 2000);
  CHECK(assembler.stats().firings == 2000U * sensor.single().firings_per_packet());
}
