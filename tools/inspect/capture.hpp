#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "tools/inspect/sensor.hpp"

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::inspect {

enum class StreamContent : std::uint8_t { kOther, kData, kTelemetry };

/// Datagrams from one sender port to one port.
struct StreamFindings {
  std::uint32_t address = 0;
  std::uint16_t sender_port = 0;
  std::uint16_t destination_port = 0;
  StreamContent content = StreamContent::kOther;
  std::uint64_t packets = 0;
  /// Of payload.
  std::uint64_t bytes = 0;
  std::uint16_t smallest = 0;
  std::uint16_t largest = 0;
};

/// Contents of one capture.
struct CaptureFindings {
  std::string path;
  std::uint64_t records = 0;
  std::uint64_t udp = 0;
  std::uint64_t cut = 0;
  std::uint64_t fragments = 0;
  std::uint64_t other_ip = 0;
  std::uint64_t not_ipv4 = 0;
  std::uint64_t malformed = 0;
  /// Stamps of the earliest and the latest record that is not malformed.
  core::Time first;
  core::Time last;
  /// By address and ports.
  std::vector<StreamFindings> streams;
  /// Datagrams of streams beyond the maximum number of separate ones.
  std::uint64_t further_streams = 0;
  /// By address and port.
  std::vector<SensorFindings> sensors;
  /// Telemetry of senders without data packets.
  std::map<std::uint32_t, TelemetryFindings> lone_telemetry;
  /// Reason of an early end of the file; empty if there was none.
  std::string early_end;

  [[nodiscard]] bool usable() const;
  [[nodiscard]] double duration_s() const { return (last - first).seconds(); }
};

/// Reads the capture once, in bounded memory. Fails when it cannot be opened.
core::Result<CaptureFindings> inspect_capture(const std::string& path);

/// One line for a capture that is not usable: its contents and the remedy.
std::string why_unusable(const CaptureFindings& capture);

}  // namespace nilio::tools::inspect
