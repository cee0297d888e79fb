#include "daemon/input/status_stream_order.hpp"

#include <algorithm>

namespace nilio::daemon {

namespace {

constexpr std::size_t kTimestampOffset = 1200;
constexpr std::size_t kStatusTypeOffset = 1204;
constexpr std::size_t kStatusValueOffset = 1205;
constexpr std::int64_t kHourUs = 3'600'000'000;
/// A packet overtaken by more is lost.
constexpr std::size_t kMostWaiting = 16;

/// a - b modulo one hour.
std::int64_t difference_us(std::uint32_t a, std::uint32_t b) {
  const std::int64_t difference = (static_cast<std::int64_t>(a) - b) % kHourUs;
  return difference > kHourUs / 2    ? difference - kHourUs
         : difference < -kHourUs / 2 ? difference + kHourUs
                                     : difference;
}

std::uint32_t timestamp_of(const drivers::Packet& packet) {
  std::uint32_t value = 0;
  for (std::size_t i = 4; i-- > 0;) value = value << 8U | packet.data[kTimestampOffset + i];
  return value;
}

}  // namespace

void StatusStreamOrder::add(const drivers::Packet& packet) {
  const StatusByte byte{timestamp_of(packet), packet.data[kStatusTypeOffset],
                        packet.data[kStatusValueOffset]};
  if (period_us_ == 0.0) {
    waiting_.push_back(byte);
    return;
  }
  if (last_us_ && difference_us(byte.timestamp_us, *last_us_) <= 0) return;
  const auto place = std::find_if(waiting_.begin(), waiting_.end(), [&](const StatusByte& other) {
    return difference_us(other.timestamp_us, byte.timestamp_us) >= 0;
  });
  if (place == waiting_.end() || place->timestamp_us != byte.timestamp_us) waiting_.insert(place, byte);
}

std::optional<StatusByte> StatusStreamOrder::next(bool& after_loss) {
  after_loss = false;
  if (waiting_.empty()) return std::nullopt;
  if (period_us_ > 0.0 && last_us_) {
    const auto step_us = static_cast<double>(difference_us(waiting_.front().timestamp_us, *last_us_));
    after_loss = step_us > 1.5 * period_us_;
  }
  if (after_loss && waiting_.size() < kMostWaiting) return std::nullopt;
  const StatusByte byte = waiting_.front();
  waiting_.erase(waiting_.begin());
  last_us_ = byte.timestamp_us;
  return byte;
}

}  // namespace nilio::daemon
