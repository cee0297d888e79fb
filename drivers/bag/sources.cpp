#include "nilio/drivers/bag/sources.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace nilio::drivers {

namespace {

using core::Error;
using core::Result;

constexpr double kStandardGravity = 9.80665;
// Samples by which the unit of accelerations is told.
constexpr std::size_t kUnitSamples = 400;

/// Decodes the messages of a topic into slots, as many as a message holds.
template <class Slot>
class BagSource : public Source<Slot> {
 public:
  /// Appends the slots of a message; false if it is damaged.
  using Decode = bool (*)(const BagTopic&, const BagMessage&, std::vector<Slot>&);

  BagSource(std::unique_ptr<BagReader> reader, std::string name, Decode decode)
      : reader_(std::move(reader)), name_(std::move(name)), decode_(decode) {}

  SourceRead read(std::span<Slot> slots, core::Duration /*timeout*/) override {
    std::size_t count = 0;
    while (count < slots.size()) {
      if (next_ == waiting_.size() && !fetch()) break;
      const std::size_t taken = std::min(slots.size() - count, waiting_.size() - next_);
      std::copy_n(waiting_.begin() + static_cast<std::ptrdiff_t>(next_), taken,
                  slots.begin() + static_cast<std::ptrdiff_t>(count));
      next_ += taken;
      count += taken;
    }
    stats_.delivered += count;
    return {count > 0 ? SourceState::kData : SourceState::kEnd, count};
  }
  [[nodiscard]] SourceStats stats() const override { return stats_; }
  [[nodiscard]] std::string status() const override {
    std::string text = name_ + ": " + std::to_string(stats_.delivered) + " delivered";
    if (stats_.malformed > 0)
      text += ", " + std::to_string(stats_.malformed) + " damaged messages and parts skipped";
    for (const std::string& note : reader_->notes()) text += "; " + note;
    return text + remark_;
  }

 protected:
  /// Decodes messages until at least one slot waits; false at the end.
  bool fetch() {
    if (next_ > 0) waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(next_));
    next_ = 0;
    const std::size_t before = waiting_.size();
    while (waiting_.size() == before) {
      const auto message = reader_->next();
      if (!message) {
        if (!std::exchange(has_ended_, true)) stats_.malformed += reader_->notes().size();
        return false;
      }
      const std::size_t kept = waiting_.size();
      if (!decode_(reader_->topics()[message->topic], *message, waiting_)) {
        // Whole packets of a damaged message are good.
        ++stats_.malformed;
        continue;
      }
      adjust(std::span(waiting_).subspan(kept));
    }
    return true;
  }
  virtual void adjust(std::span<Slot> /*slots*/) {}

  std::vector<Slot> waiting_;
  std::size_t next_ = 0;
  std::string remark_;

 private:
  std::unique_ptr<BagReader> reader_;
  std::string name_;
  Decode decode_;
  SourceStats stats_;
  bool has_ended_ = false;
};

bool decode_frame(const BagTopic& topic, const BagMessage& message, std::vector<CanFrame>& frames) {
  const auto frame = decode_can_frame(topic, message);
  if (frame) frames.push_back(*frame);
  return frame.has_value();
}

bool decode_sample(const BagTopic& topic, const BagMessage& message, std::vector<core::ImuSample>& samples) {
  const auto imu = decode_imu(topic, message);
  if (!imu || !imu->has_angular_velocity) return false;
  samples.push_back(imu->sample);
  return true;
}

/// IMU samples in SI units.
class BagImuSource : public BagSource<core::ImuSample> {
 public:
  BagImuSource(std::unique_ptr<BagReader> reader, const std::string& name, core::Duration shift)
      : BagSource(std::move(reader), name, decode_sample), shift_(shift) {
    while (waiting_.size() < kUnitSamples && fetch()) {
    }
    if (waiting_.empty()) return;
    std::vector<double> magnitudes;
    for (const core::ImuSample& sample : waiting_) {
      const auto& a = sample.linear_acceleration;
      magnitudes.push_back(std::hypot(a[0], a[1], a[2]));
    }
    const auto middle = magnitudes.begin() + static_cast<std::ptrdiff_t>(magnitudes.size() / 2);
    std::nth_element(magnitudes.begin(), middle, magnitudes.end());
    if (*middle < 0.8 || *middle > 1.2) return;
    factor_ = kStandardGravity;
    remark_ = "; accelerations are in g and converted to m/s^2";
    for (core::ImuSample& sample : waiting_) scale(sample);
  }

 protected:
  void adjust(std::span<core::ImuSample> samples) override {
    for (core::ImuSample& sample : samples) {
      sample.stamp = sample.stamp + shift_;
      scale(sample);
    }
  }

 private:
  void scale(core::ImuSample& sample) const {
    for (double& value : sample.linear_acceleration) value *= factor_;
  }

  core::Duration shift_;
  double factor_ = 1.0;
};

BagReader::Filter only(const std::string& topic) {
  return [topic](const BagTopic& candidate) {
    return candidate.name == topic && why_undecodable(candidate).empty();
  };
}

class BagCloudSource : public CloudSource {
 public:
  explicit BagCloudSource(std::unique_ptr<BagReader> reader) : reader_(std::move(reader)) {}

  bool next(CloudView& cloud) override {
    while (const auto message = reader_->next()) {
      if (decode_cloud(reader_->topics()[message->topic], *message, cloud)) return true;
      ++damaged_;
    }
    return false;
  }
  [[nodiscard]] std::uint64_t damaged() const override { return damaged_; }
  [[nodiscard]] std::vector<std::string> notes() const override { return reader_->notes(); }

 private:
  std::unique_ptr<BagReader> reader_;
  std::uint64_t damaged_ = 0;
};

template <class Slot>
Result<std::unique_ptr<Source<Slot>>> open_source(const std::vector<std::string>& files,
                                                  const std::string& topic,
                                                  typename BagSource<Slot>::Decode decode) {
  auto reader = open_bag(files, only(topic));
  if (!reader) return reader.error();
  return std::unique_ptr<Source<Slot>>(
      std::make_unique<BagSource<Slot>>(std::move(reader).value(), files.front() + " " + topic, decode));
}

}  // namespace

Result<std::unique_ptr<PacketSource>> open_bag_packets(const std::vector<std::string>& files,
                                                       const std::string& topic) {
  return open_source<Packet>(files, topic, decode_packets);
}

Result<std::unique_ptr<FrameSource>> open_bag_frames(const std::vector<std::string>& files,
                                                     const std::string& topic) {
  return open_source<CanFrame>(files, topic, decode_frame);
}

Result<std::unique_ptr<SampleSource>> open_bag_imu(const std::vector<std::string>& files,
                                                   const std::string& topic, core::Duration shift) {
  auto reader = open_bag(files, only(topic));
  if (!reader) return reader.error();
  return std::unique_ptr<SampleSource>(
      std::make_unique<BagImuSource>(std::move(reader).value(), files.front() + " " + topic, shift));
}

Result<std::unique_ptr<CloudSource>> open_bag_clouds(const std::vector<std::string>& files,
                                                     const std::string& topic) {
  auto reader = open_bag(files, only(topic));
  if (!reader) return reader.error();
  return std::unique_ptr<CloudSource>(std::make_unique<BagCloudSource>(std::move(reader).value()));
}

}  // namespace nilio::drivers
