#pragma once

#include <compare>
#include <cstdint>

namespace nilio::core {

/// Signed span of time in nanoseconds.
struct Duration {
  std::int64_t ns = 0;

  static constexpr Duration from_seconds(double seconds) {
    return {static_cast<std::int64_t>(seconds * 1e9 + (seconds < 0.0 ? -0.5 : 0.5))};
  }
  static constexpr Duration from_milliseconds(double ms) { return from_seconds(ms * 1e-3); }
  [[nodiscard]] constexpr double seconds() const { return static_cast<double>(ns) * 1e-9; }
  [[nodiscard]] constexpr double milliseconds() const { return static_cast<double>(ns) * 1e-6; }

  friend constexpr auto operator<=>(Duration, Duration) = default;  // NOLINT(modernize-use-nullptr)
  friend constexpr Duration operator+(Duration a, Duration b) { return {a.ns + b.ns}; }
  friend constexpr Duration operator-(Duration a, Duration b) { return {a.ns - b.ns}; }
  friend constexpr Duration operator-(Duration a) { return {-a.ns}; }
  friend constexpr Duration operator*(Duration a, std::int64_t k) { return {a.ns * k}; }
  friend constexpr Duration operator/(Duration a, std::int64_t k) { return {a.ns / k}; }
};

/// Point in time: nanoseconds since the Unix epoch (UTC) for measurements. The only time type of the project,
/// so that a point in time cannot be mixed up with a duration or with seconds.
struct Time {
  std::int64_t ns = 0;

  static constexpr Time from_seconds(double seconds) { return {Duration::from_seconds(seconds).ns}; }
  /// Loses precision below about 240 ns for stamps of this decade; for display and formulas, not for storage.
  [[nodiscard]] constexpr double seconds() const { return static_cast<double>(ns) * 1e-9; }

  friend constexpr auto operator<=>(Time, Time) = default;  // NOLINT(modernize-use-nullptr)
  friend constexpr Time operator+(Time a, Duration b) { return {a.ns + b.ns}; }
  friend constexpr Time operator-(Time a, Duration b) { return {a.ns - b.ns}; }
  friend constexpr Duration operator-(Time a, Time b) { return {a.ns - b.ns}; }
};

}  // namespace nilio::core
