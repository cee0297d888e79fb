#pragma once

#include "nilio/drivers/imu/decoder.hpp"
#include "nilio/drivers/source.hpp"

#include <atomic>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nilio::drivers {

/// True for a mean norm of the specific force near gravity, m/s^2. Other devices with the identifiers of an
/// IMU fail this.
bool is_plausible_imu(double mean_acceleration_m_s2);

/// Decoder of an IMU that may be on a bus.
struct ImuCandidate {
  std::string preset;
  ImuDecoder decoder;
};

/// A decoder for each built-in preset of six axes.
std::vector<ImuCandidate> imu_candidates();

/// A sample and the receive time of the frame that completed it (CLOCK_MONOTONIC, ns).
struct ReceivedSample {
  core::ImuSample sample;
  std::int64_t received_ns = 0;
};

/// Identified IMU and the samples that it was identified by.
struct IdentifiedImu {
  std::string preset;
  /// Identifiers of its frames: "0x32, 0x34".
  std::string identifiers;
  /// As ImuDecoder::taken_as_zero().
  std::string taken_as_zero;
  std::uint64_t samples = 0;
  double seconds = 0.0;
  /// Mean norm of the specific force.
  double acceleration_m_s2 = 0.0;

  [[nodiscard]] bool is_plausible() const { return is_plausible_imu(acceleration_m_s2); }
  /// For people: "identified by frames 0x32, 0x34: 200 samples in 1.0 s, specific force 9.81 m/s^2".
  [[nodiscard]] std::string text() const;
};

/// Identifies the IMU on a bus by decoding with every candidate: the plausible one with most samples, after a
/// second of its samples. The samples are buffered meanwhile, so that none is lost. Allocates only on
/// creation. One thread, unless stated otherwise.
class ImuIdentification {
 public:
  explicit ImuIdentification(std::vector<ImuCandidate> candidates);
  ImuIdentification(const ImuIdentification&) = delete;
  ImuIdentification& operator=(const ImuIdentification&) = delete;

  /// Decodes a frame; true if that identifies the IMU. Not to be called afterwards.
  bool add(const CanFrame& frame);
  /// Reads frames until the IMU is identified. At the end of the source decides by the samples so far, if
  /// need be for an implausible IMU; null without a sample.
  const IdentifiedImu* identify(FrameSource& frames);
  /// Null until the IMU is identified. Any thread.
  [[nodiscard]] const IdentifiedImu* result() const { return result_.load(std::memory_order_acquire); }

  /// Once the IMU is identified: its decoder, to continue with, and its buffered samples in order.
  [[nodiscard]] ImuDecoder take_decoder();
  [[nodiscard]] std::span<const ReceivedSample> samples() const;
  /// Samples lost because identification took longer than the buffer holds.
  [[nodiscard]] std::uint64_t samples_lost() const;
  /// Filter for the frames of all candidates.
  [[nodiscard]] ImuFrameFilter frame_filter() const;

 private:
  struct Candidate {
    ImuDecoder decoder;
    IdentifiedImu summary{};
    double acceleration_sum = 0.0;
    core::Time first{};
    std::vector<ReceivedSample> buffer{};
    std::uint64_t lost = 0;
  };
  static void take_sample(Candidate& candidate, const core::ImuSample& sample, std::int64_t received_ns);
  [[nodiscard]] Candidate* best(bool plausible);
  void decide(Candidate& candidate);

  std::vector<Candidate> candidates_;
  Candidate* chosen_ = nullptr;
  std::atomic<const IdentifiedImu*> result_{nullptr};
};

}  // namespace nilio::drivers
