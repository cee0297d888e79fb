#include "daemon/supervision/can_watch.hpp"

#include "nilio/drivers/can/socketcan/socketcan.hpp"

#include <cstdio>
#include <linux/can/error.h>
#include <utility>

namespace nilio::daemon {

namespace {

using drivers::CanBusState;
using drivers::CanEvent;

constexpr std::int64_t kCanSilenceNs = 1'000'000'000;
/// An IMU that sends is identified within a second.
constexpr std::int64_t kUnrecognisedNs = 3'000'000'000;

struct ErrorClass {
  std::uint32_t bit;
  const char* text;
};

constexpr std::array kErrorClasses{
    ErrorClass{CAN_ERR_TX_TIMEOUT, "send timeout"}, ErrorClass{CAN_ERR_LOSTARB, "lost arbitration"},
    ErrorClass{CAN_ERR_CRTL, "controller trouble"}, ErrorClass{CAN_ERR_PROT, "protocol violations"},
    ErrorClass{CAN_ERR_TRX, "transceiver trouble"}, ErrorClass{CAN_ERR_ACK, "no acknowledgement"},
    ErrorClass{CAN_ERR_BUSOFF, "bus-off"},          ErrorClass{CAN_ERR_BUSERROR, "bus errors"},
    ErrorClass{CAN_ERR_RESTARTED, "restarts"},
};

std::string describe_errors(std::uint32_t classes) {
  std::string text;
  for (const ErrorClass& error : kErrorClasses)
    if ((classes & error.bit) != 0) text += (text.empty() ? "" : ", ") + std::string(error.text);
  return text.empty() ? "unknown class" : text;
}

std::string seconds(std::int64_t ns) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.1f s", static_cast<double>(ns) * 1e-9);
  return text.data();
}

/// The last place only marks that there are more.
std::string describe_ids(const CanTraffic& traffic) {
  std::string text;
  for (std::size_t i = 0; i < CanTraffic::kIds; ++i) {
    const std::uint32_t value = traffic.other_ids[i].load(std::memory_order_relaxed);
    if (value == 0) break;
    std::array<char, 16> number{};
    std::snprintf(number.data(), number.size(), "0x%X", static_cast<unsigned>(value - 1));
    text += (i > 0 ? ", " : "") + std::string(i + 1 < CanTraffic::kIds ? number.data() : "...");
  }
  return text;
}

}  // namespace

void CanTraffic::count(const drivers::CanFrame& frame, bool takes) {
  constexpr auto relaxed = std::memory_order_relaxed;
  if (frame.error) {
    error_classes.fetch_or(frame.id, relaxed);
    error_frames.fetch_add(1, relaxed);
    return;
  }
  if (takes) {
    imu_frames.fetch_add(1, relaxed);
    return;
  }
  for (auto& id : other_ids) {
    const std::uint32_t known = id.load(relaxed);
    if (known == frame.id + 1) break;
    if (known != 0) continue;
    id.store(frame.id + 1, relaxed);
    break;
  }
  other_frames.fetch_add(1, relaxed);
}

WatchedFrames::WatchedFrames(std::unique_ptr<drivers::FrameSource> source, drivers::ImuFrameFilter filter,
                             std::shared_ptr<CanTraffic> traffic)
    : source_(std::move(source)), filter_(std::move(filter)), traffic_(std::move(traffic)) {}

drivers::SourceRead WatchedFrames::read(std::span<drivers::CanFrame> slots, core::Duration timeout) {
  const drivers::SourceRead read = source_->read(slots, timeout);
  for (const drivers::CanFrame& frame : slots.first(read.count)) traffic_->count(frame, filter_.takes(frame));
  return read;
}

ImuSilence::ImuSilence(std::shared_ptr<CanTraffic> traffic, std::string identifiers)
    : traffic_(std::move(traffic)), identifiers_(std::move(identifiers)) {}

std::vector<CanEvent> ImuSilence::observe(std::int64_t now_ns, CanBusState bus) {
  std::vector<CanEvent> events;
  const std::uint64_t frames = traffic_->imu_frames.load(std::memory_order_relaxed);
  const bool first = last_frame_ns_ < 0;
  if (frames != frames_ || first) {
    if (silent_ && !first)
      events.push_back({false, "IMU frames received again after " + seconds(now_ns - last_frame_ns_)});
    silent_ = false;
    frames_ = frames;
    last_frame_ns_ = now_ns;
    others_at_last_frame_ = traffic_->other_frames.load(std::memory_order_relaxed);
    errors_at_last_frame_ = traffic_->error_frames.load(std::memory_order_relaxed);
    traffic_->error_classes.store(0, std::memory_order_relaxed);
    return events;
  }
  if (silent_ || now_ns - last_frame_ns_ < kCanSilenceNs) return events;
  silent_ = true;
  ++silences_;
  events.push_back({true, "IMU silent: no frame with " + identifiers_ + " for " +
                              seconds(now_ns - last_frame_ns_) + "; the bus is " + std::string(name_of(bus)) +
                              ", " + seen_instead() + "; odometry continues without the IMU"});
  return events;
}

std::string ImuSilence::seen_instead() const {
  const std::uint64_t others = traffic_->other_frames.load(std::memory_order_relaxed) - others_at_last_frame_;
  const std::uint64_t errors = traffic_->error_frames.load(std::memory_order_relaxed) - errors_at_last_frame_;
  if (others + errors == 0)
    return "no other frames on the bus - check the IMU's power and cable, and the bit rate";
  std::string text = "received instead: ";
  if (others > 0)
    text += std::to_string(others) + " frames of other identifiers (" + describe_ids(*traffic_) + ")";
  if (errors > 0) {
    text += (others > 0 ? " and " : "") + std::to_string(errors) + " error frames (" +
            describe_errors(traffic_->error_classes.load(std::memory_order_relaxed)) + ")";
  }
  return text + (others > 0 ? " - check the IMU, and imu.preset or imu.dbc" : " - check bit rate and wiring");
}

ImuRecognition::ImuRecognition(std::shared_ptr<CanTraffic> traffic, std::string interface_name,
                               const drivers::ImuIdentification* identification)
    : traffic_(std::move(traffic)),
      interface_name_(std::move(interface_name)),
      identification_(identification) {}

std::optional<EventLog::Line> ImuRecognition::observe(std::int64_t now_ns) {
  if (recognised_) return std::nullopt;
  const std::uint64_t own = traffic_->imu_frames.load(std::memory_order_relaxed);
  const std::uint64_t frames = own + traffic_->other_frames.load(std::memory_order_relaxed);
  const drivers::IdentifiedImu* const imu = identification_ == nullptr ? nullptr : identification_->result();
  recognised_ = identification_ == nullptr ? own > 0 : imu != nullptr;
  if (imu != nullptr) {
    std::string text = "IMU " + imu->preset + " on CAN " + interface_name_ + " " + imu->text();
    if (!imu->taken_as_zero.empty()) text += "; it has no " + imu->taken_as_zero + ": taken as 0";
    if (const std::uint64_t lost = identification_->samples_lost(); lost > 0)
      text += "; " + std::to_string(lost) + " samples before were lost";
    return EventLog::Line{LogLevel::kInfo, text};
  }
  if (traffic_since_ns_ < 0 && frames > 0) traffic_since_ns_ = now_ns;
  if (recognised_ || failed_ || traffic_since_ns_ < 0 || now_ns - traffic_since_ns_ < kUnrecognisedNs)
    return std::nullopt;
  failed_ = true;
  return EventLog::Line{
      LogLevel::kError,
      "IMU: no sample decodes from " + std::to_string(frames) + " frames on " + interface_name_ +
          (identification_ == nullptr ? "" : ", which are of no built-in IMU (imu.preset: auto)") +
          "; odometry continues without the IMU - record the bus with 'nilio record FOLDER --can " +
          interface_name_ +
          "', see what is in it with 'nilio inspect FOLDER --write-config vehicle.yaml', and "
          "set imu.preset or imu.dbc"};
}

CanWatch::CanWatch(std::unique_ptr<drivers::CanController> controller, std::shared_ptr<CanTraffic> traffic,
                   std::string identifiers, ImuRecognition recognition)
    : controller_(std::move(controller)),
      traffic_(traffic),
      silence_(std::move(traffic), std::move(identifiers)),
      recognition_(std::move(recognition)) {}

std::vector<CanEvent> CanWatch::poll(std::int64_t now_ns) {
  std::vector<CanEvent> events = controller_->take_events();
  for (CanEvent& event : silence_.observe(now_ns, controller_->status().state))
    events.push_back(std::move(event));
  return events;
}

std::map<std::string, std::uint64_t> CanWatch::counters() const {
  const drivers::CanControllerStatus bus = controller_->status();
  return {{"can_other_frames", traffic_->other_frames.load()},
          {"can_error_frames", traffic_->error_frames.load()},
          {"can_bus_offs", bus.bus_offs},
          {"can_restarts", bus.restarts},
          {"can_times_down", bus.times_down},
          {"can_times_gone", bus.times_gone},
          {"imu_silences", silence_.silences()}};
}

core::Result<LiveCan> open_live_can(const ImuConfig& config, const drivers::ImuFrameFilter& filter,
                                    const drivers::ImuIdentification* identification) {
  // The controller first: setting up an interface restarts it, which a reader would count as an outage.
  auto controller =
      drivers::CanController::watch({config.interface_name, static_cast<std::uint32_t>(config.bitrate),
                                     static_cast<std::uint32_t>(config.restart_ms)});
  if (!controller) return core::Error{"imu.interface: " + controller.error().message};
  drivers::SocketCanConfig source_config;
  source_config.interface_name = config.interface_name;
  source_config.wait_for_interface = true;
  auto source = drivers::open_socketcan(source_config);
  if (!source) return core::Error{"imu.interface: " + source.error().message};
  auto traffic = std::make_shared<CanTraffic>();
  LiveCan live;
  live.frames = std::make_unique<WatchedFrames>(std::move(source).value(), filter, traffic);
  live.watch = std::make_unique<CanWatch>(std::move(controller).value(), traffic, filter.text(),
                                          ImuRecognition(traffic, config.interface_name, identification));
  return live;
}

}  // namespace nilio::daemon
