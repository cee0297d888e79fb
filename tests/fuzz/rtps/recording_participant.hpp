#pragma once

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

}  // namespace nilio::fuzz
