#pragma once

#include <cstdint>

namespace nilio::daemon {

/// Kind of a run, and how its parts treat time.
class RunRules {
 public:
  enum class Kind : std::uint8_t {
    kReplay,        ///< a recording as fast as possible, repeatable bit by bit
    kPacedReplay,   ///< a recording at its own pace
    kReplayAsLive,  ///< a recording at its own pace under the rules of a live run
    kLive,          ///< sensors
  };

  constexpr RunRules(Kind kind = Kind::kReplay) : kind_(kind) {}  // NOLINT(google-explicit-constructor)

  [[nodiscard]] constexpr bool has_sensors() const { return kind_ == Kind::kLive; }
  /// Data of a recording are due at their distance from the start.
  [[nodiscard]] constexpr bool is_paced() const {
    return kind_ == Kind::kPacedReplay || kind_ == Kind::kReplayAsLive;
  }
  /// Live rules: full rings drop data, the newest scan wins, waits time out, the clock limits the work.
  /// Without them nothing is lost, and the results depend on the data only.
  [[nodiscard]] constexpr bool are_live() const {
    return kind_ == Kind::kLive || kind_ == Kind::kReplayAsLive;
  }

 private:
  Kind kind_;
};

}  // namespace nilio::daemon
