#include "core/src/estimation/imu_buffer.hpp"

#include <cmath>

namespace nilio::core {

namespace {

Vector3 mean_of(const ImuBuffer& buffer, Vector3 BaseImuSample::*member, Time from, Time to) {
  std::size_t next = buffer.lower_bound(from);
  if (buffer[next].stamp == from) ++next;
  const auto interpolated = [&](std::size_t after, Time time) -> Vector3 {
    const BaseImuSample& a = buffer[after - 1];
    const BaseImuSample& b = buffer[after];
    const double share = (time - a.stamp).seconds() / (b.stamp - a.stamp).seconds();
    return a.*member + share * (b.*member - a.*member);
  };
  Vector3 sum = Vector3::Zero();
  Vector3 left = interpolated(next, from);
  Time time = from;
  for (; buffer[next].stamp < to; ++next) {
    sum += 0.5 * (buffer[next].stamp - time).seconds() * (left + buffer[next].*member);
    left = buffer[next].*member;
    time = buffer[next].stamp;
  }
  sum += 0.5 * (to - time).seconds() * (left + interpolated(next, to));
  return sum / (to - from).seconds();
}

}  // namespace

ImuBuffer::ImuBuffer(std::size_t capacity) : samples_(capacity) {}

bool ImuBuffer::add(const ImuSample& sample, const Eigen::Quaterniond& R_base_imu) {
  const Vector3 rate(sample.angular_velocity[0], sample.angular_velocity[1], sample.angular_velocity[2]);
  const Vector3 force(sample.linear_acceleration[0], sample.linear_acceleration[1],
                      sample.linear_acceleration[2]);
  if (!rate.allFinite() || !force.allFinite()) return false;
  if (size_ > 0 && sample.stamp <= (*this)[size_ - 1].stamp) return false;
  if (size_ == samples_.size()) {
    first_ = (first_ + 1) % samples_.size();
    --size_;
  }
  samples_[(first_ + size_) % samples_.size()] = {sample.stamp, R_base_imu * rate, R_base_imu * force};
  ++size_;
  return true;
}

void ImuBuffer::move_stamps(Duration by) {
  for (BaseImuSample& sample : samples_) sample.stamp = sample.stamp + by;
}

std::optional<Time> ImuBuffer::latest() const {
  if (size_ == 0) return std::nullopt;
  return (*this)[size_ - 1].stamp;
}

std::size_t ImuBuffer::lower_bound(Time time) const {
  std::size_t low = 0;
  std::size_t high = size_;
  while (low < high) {
    const std::size_t middle = (low + high) / 2;
    if ((*this)[middle].stamp < time) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  return low;
}

bool ImuBuffer::covers(Time from, Time to, Duration max_gap) const {
  if (size_ < 2 || (*this)[0].stamp > from || (*this)[size_ - 1].stamp < to) return false;
  // From the last sample not after `from` to the first not before `to`.
  std::size_t i = lower_bound(from);
  if ((*this)[i].stamp > from) --i;
  for (; i + 1 < size_ && (*this)[i].stamp < to; ++i) {
    if ((*this)[i + 1].stamp - (*this)[i].stamp > max_gap) return false;
  }
  return true;
}

Vector3 ImuBuffer::value_at(Vector3 BaseImuSample::*member, Time time) const {
  const std::size_t next = lower_bound(time);
  if (next == 0) return (*this)[0].*member;
  if (next == size_) return (*this)[size_ - 1].*member;
  const BaseImuSample& a = (*this)[next - 1];
  const BaseImuSample& b = (*this)[next];
  const double share = (time - a.stamp).seconds() / (b.stamp - a.stamp).seconds();
  return a.*member + share * (b.*member - a.*member);
}

Vector3 mean_angular_velocity(const ImuBuffer& buffer, Time from, Time to) {
  return mean_of(buffer, &BaseImuSample::angular_velocity, from, to);
}

Vector3 mean_specific_force(const ImuBuffer& buffer, Time from, Time to) {
  return mean_of(buffer, &BaseImuSample::linear_acceleration, from, to);
}

ImuStatistics imu_statistics(const ImuBuffer& buffer, Time from, Time to) {
  ImuStatistics statistics;
  const std::size_t begin = buffer.lower_bound(from);
  std::size_t end = begin;
  for (; end < buffer.size() && buffer[end].stamp <= to; ++end) {
    statistics.mean_angular_velocity += buffer[end].angular_velocity;
    statistics.mean_acceleration += buffer[end].linear_acceleration;
  }
  statistics.count = end - begin;
  if (statistics.count == 0) return statistics;
  const double inverse_count = 1.0 / static_cast<double>(statistics.count);
  statistics.mean_angular_velocity *= inverse_count;
  statistics.mean_acceleration *= inverse_count;
  double rate_square = 0.0;
  double force_square = 0.0;
  for (std::size_t i = begin; i < end; ++i) {
    rate_square += (buffer[i].angular_velocity - statistics.mean_angular_velocity).squaredNorm();
    force_square += (buffer[i].linear_acceleration - statistics.mean_acceleration).squaredNorm();
  }
  statistics.angular_velocity_deviation = std::sqrt(rate_square * inverse_count);
  statistics.acceleration_deviation = std::sqrt(force_square * inverse_count);
  return statistics;
}

}  // namespace nilio::core
