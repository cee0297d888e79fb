#include "nilio/drivers/imu/decoder.hpp"

#include "drivers/imu/decoder_state.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace nilio::drivers {

namespace {

/// A vehicle rolls and nods little and around 0, so that one of the two rates can be done without.
bool is_one_level_rate(const ImuMapping& mapping, const std::string& missing) {
  for (const std::size_t axis : {std::size_t{0}, std::size_t{1}}) {
    ImuMapping completed = mapping;
    completed.angular_velocity[axis] = mapping.angular_velocity[2];
    if (missing_axes(completed).empty()) return !missing.empty();
  }
  return false;
}

}  // namespace

ImuDecoder::ImuDecoder(std::unique_ptr<State> state) : state_(std::move(state)) {}
ImuDecoder::ImuDecoder(ImuDecoder&&) noexcept = default;
ImuDecoder& ImuDecoder::operator=(ImuDecoder&&) noexcept = default;
ImuDecoder::~ImuDecoder() = default;

core::Result<ImuDecoder> ImuDecoder::create(const ImuMapping& mapping, const DbcDatabase& database) {
  const std::string missing = missing_axes(mapping);
  if (!missing.empty() && !is_one_level_rate(mapping, missing)) {
    return core::Error{"IMU '" + mapping.name + "' has no " + missing +
                       "; the motion during a scan needs all six axes but for one of angular velocity x and "
                       "y: use another IMU, or none"};
  }
  core::Result<ImuDecoder> decoder = create_partial(mapping, database);
  if (decoder && !missing.empty()) decoder->state_->take_as_zero(missing);
  return decoder;
}

core::Result<ImuDecoder> ImuDecoder::create_partial(const ImuMapping& mapping, const DbcDatabase& database) {
  core::Result<std::vector<ImuRoute>> routes = make_imu_routes(mapping, database);
  if (!routes) return routes.error();
  const bool has_axis =
      std::any_of(routes->begin(), routes->end(), [](const ImuRoute& route) { return !route.axes.empty(); });
  if (!has_axis) return core::Error{"IMU '" + mapping.name + "' has no axis at all: map at least one"};
  return ImuDecoder(std::make_unique<State>(mapping, std::move(routes).value()));
}

std::optional<core::ImuSample> ImuDecoder::add(const CanFrame& frame) {
  std::optional<core::ImuSample> sample = state_->add(frame);
  if (sample) sample->stamp = sample->stamp - state_->time_offset;
  return sample;
}

const std::string& ImuDecoder::taken_as_zero() const { return state_->taken_as_zero; }

const ImuDecoderStats& ImuDecoder::stats() const { return state_->stats; }

bool ImuFrameFilter::takes(const CanFrame& frame) const {
  if (frame.error || frame.remote) return false;
  return std::any_of(identifiers_.begin(), identifiers_.end(), [&frame](const Identifier& own) {
    if (own.extended != frame.extended) return false;
    return own.j1939 ? j1939_group(own.id) == j1939_group(frame.id) : own.id == frame.id;
  });
}

std::string ImuFrameFilter::text() const {
  std::string text;
  for (const Identifier& own : identifiers_) {
    std::array<char, 16> number{};
    std::snprintf(number.data(), number.size(), "0x%X", static_cast<unsigned>(own.id));
    text += (text.empty() ? "" : ", ") + std::string(number.data());
  }
  return text;
}

ImuFrameFilter ImuDecoder::frame_filter() const {
  std::vector<ImuFrameFilter::Identifier> identifiers;
  for (const ImuRoute& route : state_->routes)
    identifiers.push_back({route.message.id, route.message.extended, route.message.j1939});
  return ImuFrameFilter(std::move(identifiers));
}

std::optional<double> ImuDecoder::temperature_degc() const { return state_->temperature; }

}  // namespace nilio::drivers
