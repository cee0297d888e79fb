#pragma once

#include "nilio/core/time.hpp"

#include "tests/fuzz/rtps/mutations.hpp"

#include <cstdint>
#include <memory>
#include <vector>

namespace nilio::fuzz {

/// A participant with every writer and reader of nilio that records the datagrams it sends. On loopback.
class RecordingParticipant {
 public:
  explicit RecordingParticipant(std::uint32_t domain);
  ~RecordingParticipant();
  RecordingParticipant(const RecordingParticipant&) = delete;
  RecordingParticipant& operator=(const RecordingParticipant&) = delete;

  /// Writes one message of every type, the latency report in fragments.
  void write();
  [[nodiscard]] bool is_matched() const;
  /// Messages received from the others' writers.
  [[nodiscard]] std::uint64_t received() const;
  /// Different datagrams that it has sent since its creation.
  [[nodiscard]] std::vector<Datagram> recording() const;

 private:
  struct Entities;
  std::unique_ptr<Entities> entities_;
};

/// Publishes and subscribes as nilio-publisher and `nilio watch` do, on loopback, until the parent process
/// ends. Writes one byte to standard output when it is ready.
[[noreturn]] void run_victim(std::uint32_t domain);

/// True if a new subscriber on loopback receives a pose within `patience`.
bool receives_pose(std::uint32_t domain, core::Duration patience);

}  // namespace nilio::fuzz
