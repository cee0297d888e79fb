#include "nilio/core/units.hpp"

#include "tools/common/text.hpp"
#include "tools/inspect/report/report.hpp"

#include <algorithm>

namespace nilio::tools::inspect {

namespace {

constexpr double kLevelDeg = 3.0;

unsigned long long count(std::uint64_t n) { return n; }

std::string row(const char* name, const std::string& value) {
  return format("  %-16s %s\n", name, value.c_str());
}

std::string message_name(const CanMessageFindings& message) {
  return format(message.extended ? "%08X" : "%03X", message.id);
}

bool has_names(const CanFindings& can) {
  return std::any_of(can.messages.begin(), can.messages.end(),
                     [](const CanMessageFindings& m) { return !m.name.empty(); });
}

std::string message_table(const CanFindings& can) {
  constexpr std::size_t kShown = 24;
  std::vector<CanMessageFindings> sorted = can.messages;
  std::stable_sort(
      sorted.begin(), sorted.end(),
      [](const CanMessageFindings& a, const CanMessageFindings& b) { return a.frames > b.frames; });
  std::string text = without_trailing_space(
      format("\n  %-10s %-9s %10s %7s %9s %10s %12s %6s  %s", "interface", "id", "frames", "bytes", "rate Hz",
             "jitter ms", "maximum ms", "gaps", has_names(can) ? "message" : ""));
  for (std::size_t i = 0; i < std::min(kShown, sorted.size()); ++i) {
    const CanMessageFindings& message = sorted[i];
    const std::string bytes = message.shortest == message.longest
                                  ? format("%u", message.longest)
                                  : format("%u-%u", message.shortest, message.longest);
    text += without_trailing_space(format(
        "  %-10s %-9s %10llu %7s %9.1f %10.3f %12.3f %6llu  %s",
        printable_text(message.interface_name).c_str(), message_name(message).c_str(), count(message.frames),
        bytes.c_str(), message.rate_hz(), message.interval_s.standard_deviation() * 1e3,
        message.interval_s.maximum() * 1e3, count(message.gaps), printable_text(message.name).c_str()));
  }
  if (sorted.size() > kShown)
    text += format("  and %zu rarer identifiers (--json has them)\n", sorted.size() - kShown);
  return text + "\n";
}

/// Signals of the messages in the DBC.
std::string signal_table(const CanFindings& can) {
  if (!has_names(can)) return "";
  std::string text = format("  %-10s %-9s %-28s %8s %11s %11s %11s  %s\n", "interface", "id", "signal",
                            "values", "minimum", "mean", "maximum", "unit");
  for (const CanMessageFindings& message : can.messages) {
    for (const CanSignalFindings& signal : message.signals) {
      text += without_trailing_space(format(
          "  %-10s %-9s %-28s %8llu %11.5g %11.5g %11.5g  %s", printable_text(message.interface_name).c_str(),
          message_name(message).c_str(), printable_text(signal.name).c_str(), count(signal.physical.count()),
          signal.physical.minimum(), signal.physical.mean(), signal.physical.maximum(),
          printable_text(signal.unit).c_str()));
    }
  }
  return text + "\n";
}

std::string axes_text(const std::array<Spread, 3>& axes, double scale, const char* unit) {
  return format("%+.3f %+.3f %+.3f %s", axes[0].mean() * scale, axes[1].mean() * scale,
                axes[2].mean() * scale, unit);
}

std::string level_text(double tilt_deg) {
  if (tilt_deg < kLevelDeg) return format("level (%.1f deg)", tilt_deg);
  if (tilt_deg > 180.0 - 10.0 * kLevelDeg)
    return format("UPSIDE DOWN (z points %.1f deg from up): set imu.extrinsic", tilt_deg);
  return format("tilted by %.1f deg: mounted so, on a slope, or accelerating", tilt_deg);
}

}  // namespace

std::string imu_report(const ImuFindings& imu) {
  std::string text;
  if (imu.stats.samples == 0) {
    return row("IMU", format("%llu frames of %s on %s, but some of its messages are missing: no sample",
                             count(imu.stats.frames), imu.preset.c_str(),
                             printable_text(imu.interface_name).c_str()));
  }
  if (!imu.plausible()) {
    return row(
        "IMU",
        format("the identifiers of %s are on %s, but the acceleration is %.2f m/s^2 on average: another "
               "device, or one that is set to other units",
               imu.preset.c_str(), printable_text(imu.interface_name).c_str(), imu.acceleration_m_s2.mean()));
  }
  text += row("IMU",
              format("%s on %s: %llu samples, %.1f Hz, jitter %.3f ms, largest gap %s", imu.preset.c_str(),
                     printable_text(imu.interface_name).c_str(), count(imu.stats.samples), imu.rate_hz(),
                     imu.interval_s.standard_deviation() * 1e3, span_text(imu.interval_s.maximum()).c_str()));
  if (imu.stats.incomplete + imu.stats.short_frames + imu.stats.out_of_order > 0) {
    text += row("", format("%llu incomplete samples, %llu short frames, %llu out of order",
                           count(imu.stats.incomplete), count(imu.stats.short_frames),
                           count(imu.stats.out_of_order)));
  }
  text += row("acceleration", format("%.3f m/s^2 on average, axes %s", imu.acceleration_m_s2.mean(),
                                     axes_text(imu.linear_acceleration, 1.0, "m/s^2").c_str()));
  if (imu.still_seconds > 0) {
    text += row("gyro bias", format("%s, from %llu s at rest or straight ahead",
                                    axes_text(imu.still_angular_velocity, kDegreesPerRadian, "deg/s").c_str(),
                                    count(imu.still_seconds)));
  } else {
    text += row("gyro bias", "unknown: turning or vibrating all the time");
  }
  if (const auto tilt = imu.tilt_deg()) text += row("attitude", level_text(*tilt));
  return text;
}

std::string can_report(const CanFindings& can) {
  std::string text = can.path + "\n";
  if (can.frames == 0) return text + row("frames", "none");
  if (can.has_wall_clock()) {
    text += format("  %s to %s UTC, %s\n", utc_text(can.first).c_str(), utc_text(can.last).c_str(),
                   span_text(can.duration_s()).c_str());
  } else {
    text +=
        format("  %s, stamps count from %.3f s\n", span_text(can.duration_s()).c_str(), can.first.seconds());
  }
  std::string interfaces;
  for (const auto& [name, frames] : can.interfaces)
    interfaces +=
        format("%s%s %llu", interfaces.empty() ? "" : ", ", printable_text(name).c_str(), count(frames));
  text += format("  %llu frames: %s", count(can.frames), interfaces.c_str());
  const auto add = [&](std::uint64_t n, const char* what) {
    if (n > 0) text += format(", %llu %s", count(n), what);
  };
  add(can.error_frames, "ERROR FRAMES");
  add(can.remote_frames, "remote");
  add(can.fd_frames, "CAN FD");
  add(can.out_of_order, "out of order");
  text += "\n";
  if (can.broken_lines > 0)
    text += format("  %llu broken lines, the first is line %llu\n", count(can.broken_lines),
                   count(can.first_broken_line));
  if (!can.messages.empty()) text += message_table(can) + signal_table(can);
  for (const ImuFindings& imu : can.imus) text += imu_report(imu);
  if (can.imus.empty()) {
    std::string presets;
    for (const std::string& name : drivers::imu_preset_names())
      presets += (presets.empty() ? "" : ", ") + name;
    text += row("IMU",
                "none of the built-in ones (" + presets + "); other devices: imu.dbc and six mapped signals");
  }
  return text;
}

}  // namespace nilio::tools::inspect
