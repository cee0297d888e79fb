#include "nilio/drivers/can/socketcan/socketcan.hpp"

#include "nilio/core/clock.hpp"

#include "drivers/can/socketcan/can_interface.hpp"
#include "drivers/can/socketcan/can_socket.hpp"
#include "drivers/common/counters.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

namespace nilio::drivers {
namespace {

using core::Error;

/// Frames per system call.
constexpr std::size_t kBatch = 64;
/// Period of the checks for a missing interface and for an idle one that was replaced.
constexpr std::int64_t kCheckPeriodNs = 200'000'000;

struct OpenedCan {
  BoundCanSocket bound;
  int buffer_bytes = 0;
};

core::Result<OpenedCan> open_for_receiving(const SocketCanConfig& config);

class SocketCanSource final : public FrameSource {
 public:
  SocketCanSource(OpenedCan opened, const SocketCanConfig& config)
      : bound_(std::move(opened.bound)), config_(config), buffer_bytes_(opened.buffer_bytes) {}

  SourceRead read(std::span<CanFrame> slots, core::Duration timeout) override;
  [[nodiscard]] SourceStats stats() const override { return counters_.read(); }
  [[nodiscard]] std::string status() const override;

 private:
  int receive(std::size_t count);
  std::size_t take(std::size_t received, std::span<CanFrame> slots);
  SourceRead interrupted(int error);
  void close_socket();
  bool reopen(core::Duration timeout);
  void check_same_interface();
  void note_error_frame(const CanFrame& frame);

  BoundCanSocket bound_;
  const SocketCanConfig config_;
  std::atomic<int> buffer_bytes_;
  SourceCounters counters_;
  std::atomic<std::uint64_t> interruptions_{0};
  std::atomic<std::uint64_t> error_frames_{0};
  std::atomic<std::uint64_t> bus_offs_{0};
  std::atomic<int> failure_{0};
  std::uint32_t last_drop_count_ = 0;
  std::int64_t next_check_ns_ = 0;
  std::array<mmsghdr, kBatch> messages_{};
  std::array<iovec, kBatch> buffers_{};
  std::array<canfd_frame, kBatch> frames_{};
  std::array<ControlBuffer, kBatch> controls_{};
};

bool wait_for(int descriptor, core::Duration timeout) {
  const timespec limit = to_timespec(timeout);
  pollfd waited{.fd = descriptor, .events = POLLIN, .revents = 0};
  return ppoll(&waited, descriptor >= 0 ? 1 : 0, &limit, nullptr) > 0;
}

SourceRead SocketCanSource::read(std::span<CanFrame> slots, core::Duration timeout) {
  if (failure_.load(std::memory_order_relaxed) != 0) return {SourceState::kFailed, 0};
  if (slots.empty() || (!bound_.socket.is_open() && !reopen(timeout))) return {SourceState::kIdle, 0};
  const std::size_t count = std::min(slots.size(), kBatch);
  int received = receive(count);
  if (received < 0 && errno == EAGAIN) {
    if (!wait_for(bound_.socket.get(), timeout)) {
      check_same_interface();
      return {SourceState::kIdle, 0};
    }
    received = receive(count);
  }
  if (received < 0) return interrupted(errno);
  const std::size_t kept = take(static_cast<std::size_t>(received), slots);
  counters_.add_delivered(kept);
  return {kept > 0 ? SourceState::kData : SourceState::kIdle, kept};
}

/// Returns as recvmmsg() does: the number of frames, or -1 and errno.
int SocketCanSource::receive(std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    buffers_[i] = {.iov_base = &frames_[i], .iov_len = sizeof(canfd_frame)};
    messages_[i] = {};
    msghdr& header = messages_[i].msg_hdr;
    header.msg_iov = &buffers_[i];
    header.msg_iovlen = 1;
    header.msg_control = controls_[i].bytes.data();
    header.msg_controllen = controls_[i].bytes.size();
  }
  return recvmmsg(bound_.socket.get(), messages_.data(), static_cast<unsigned>(count), MSG_DONTWAIT, nullptr);
}

std::size_t SocketCanSource::take(std::size_t received, std::span<CanFrame> slots) {
  const std::int64_t received_ns = monotonic_ns();
  std::size_t kept = 0;
  for (std::size_t i = 0; i < received; ++i) {
    const ReceivedControl control = read_control(messages_[i].msg_hdr);
    if (control.drops) {
      counters_.add_kernel_dropped(*control.drops - last_drop_count_);
      last_drop_count_ = *control.drops;
    }
    const std::optional<CanFrame> frame = from_kernel_frame(frames_[i], messages_[i].msg_len);
    if (!frame) {
      counters_.add_malformed(1);
      continue;
    }
    CanFrame& slot = slots[kept++];
    slot = *frame;
    slot.stamp = control.stamp;
    slot.received_ns = received_ns;
    if (slot.error) note_error_frame(slot);
  }
  return kept;
}

void SocketCanSource::note_error_frame(const CanFrame& frame) {
  error_frames_.fetch_add(1, std::memory_order_relaxed);
  if ((frame.id & CAN_ERR_BUSOFF) != 0) bus_offs_.fetch_add(1, std::memory_order_relaxed);
}

/// An interface that goes down reports ENETDOWN once; the socket works again when it is up. A removed
/// interface reports ENODEV once; its socket then stays silent for ever.
SourceRead SocketCanSource::interrupted(int error) {
  if (error == EAGAIN || error == EINTR) return {SourceState::kIdle, 0};
  if (error != ENETDOWN && error != ENODEV) {
    failure_.store(error, std::memory_order_relaxed);
    return {SourceState::kFailed, 0};
  }
  interruptions_.fetch_add(1, std::memory_order_relaxed);
  if (error == ENODEV) close_socket();
  return {SourceState::kIdle, 0};
}

void SocketCanSource::close_socket() {
  bound_ = {};
  last_drop_count_ = 0;
}

/// Opens the interface again if it is back; waits for the next check, at most `timeout`.
bool SocketCanSource::reopen(core::Duration timeout) {
  const std::int64_t left = next_check_ns_ - monotonic_ns();
  if (left > 0) {
    wait_for(-1, {std::min(left, timeout.ns)});
    if (left > timeout.ns) return false;
  }
  next_check_ns_ = monotonic_ns() + kCheckPeriodNs;
  core::Result<OpenedCan> opened = open_for_receiving(config_);
  if (!opened) return false;
  bound_ = std::move(opened->bound);
  buffer_bytes_.store(opened->buffer_bytes, std::memory_order_relaxed);
  return true;
}

/// Detects an adapter that was unplugged and plugged in again: it has the old name and a new number.
void SocketCanSource::check_same_interface() {
  const std::int64_t now = monotonic_ns();
  if (now < next_check_ns_) return;
  next_check_ns_ = now + kCheckPeriodNs;
  if (if_nametoindex(config_.interface_name.c_str()) == bound_.interface_index) return;
  interruptions_.fetch_add(1, std::memory_order_relaxed);
  close_socket();
}

std::string SocketCanSource::status() const {
  const SourceStats stats = counters_.read();
  std::string text = "CAN " + config_.interface_name + ": ";
  if (const int error = failure_.load(std::memory_order_relaxed); error != 0)
    return text + "receiving failed: " + std::strerror(error) + "; check the interface and its driver";
  const CanInterfaceState state = query_can_interface(config_.interface_name);
  text += describe_can_interface(config_.interface_name, state) + "; " + std::to_string(stats.delivered) +
          " frames";
  const auto add = [&text](std::uint64_t count, const char* what) {
    if (count > 0) text += ", " + std::to_string(count) + what;
  };
  add(error_frames_.load(std::memory_order_relaxed), " of them error frames");
  add(bus_offs_.load(std::memory_order_relaxed), " times bus-off");
  add(stats.kernel_dropped, " dropped by the kernel");
  add(stats.malformed, " malformed");
  add(interruptions_.load(std::memory_order_relaxed), " times down or gone");
  text += ", " + describe_receive_buffer(buffer_bytes_.load(std::memory_order_relaxed),
                                         config_.receive_buffer_bytes);
  if (stats.delivered == 0 && state.up)
    text += "; nothing arrives: check bit rate, wiring and that the IMU sends";
  return text;
}

/// Sets the options and returns the receive buffer obtained.
core::Result<int> configure(int descriptor, const SocketCanConfig& config) {
  const std::string where = "CAN " + config.interface_name + ": ";
  if (!set_socket_option(descriptor, SOL_SOCKET, SO_TIMESTAMPNS, 1) ||
      !set_socket_option(descriptor, SOL_SOCKET, SO_RXQ_OVFL, 1) ||
      !set_socket_option(descriptor, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, can_err_mask_t{CAN_ERR_MASK}))
    return Error{where + "no kernel time stamps, drop counts and error frames: " + std::strerror(errno) +
                 "; check the kernel"};
  // An empty filter list would block every frame.
  if (!config.filters.empty()) {
    std::vector<can_filter> filters;
    for (const CanFilter& filter : config.filters) {
      const std::uint32_t flag = filter.extended ? CAN_EFF_FLAG : 0U;
      const std::uint32_t bits = filter.extended ? CAN_EFF_MASK : CAN_SFF_MASK;
      filters.push_back(
          {.can_id = (filter.id & bits) | flag, .can_mask = (filter.mask & bits) | CAN_EFF_FLAG});
    }
    if (setsockopt(descriptor, SOL_CAN_RAW, CAN_RAW_FILTER, filters.data(),
                   static_cast<socklen_t>(filters.size() * sizeof(can_filter))) != 0)
      return Error{where + std::to_string(filters.size()) + " filters are rejected: " + std::strerror(errno) +
                   "; the kernel takes 512"};
  }
  return request_receive_buffer(descriptor, config.receive_buffer_bytes).value_or(0);
}

core::Result<OpenedCan> open_for_receiving(const SocketCanConfig& config) {
  core::Result<FileDescriptor> socket = make_can_socket(config.interface_name);
  if (!socket) return socket.error();
  const core::Result<int> buffer = configure(socket->get(), config);
  if (!buffer) return buffer.error();
  core::Result<BoundCanSocket> bound = bind_can_socket(std::move(socket).value(), config.interface_name);
  if (!bound) return bound.error();
  return OpenedCan{std::move(bound).value(), *buffer};
}

}  // namespace

core::Result<std::unique_ptr<FrameSource>> open_socketcan(const SocketCanConfig& config) {
  core::Result<OpenedCan> opened = open_for_receiving(config);
  if (!opened) {
    // Only a missing interface can appear later; a kernel without CAN or a wrong interface is an error.
    const bool may_come = config.wait_for_interface && make_can_socket(config.interface_name).ok() &&
                          if_nametoindex(config.interface_name.c_str()) == 0;
    if (!may_come) return opened.error();
    opened = OpenedCan{{}, config.receive_buffer_bytes};
  }
  return std::unique_ptr<FrameSource>(std::make_unique<SocketCanSource>(std::move(opened).value(), config));
}

core::Result<CanSender> CanSender::open(const std::string& interface_name) {
  core::Result<FileDescriptor> socket = make_can_socket(interface_name);
  if (!socket) return socket.error();
  // An empty filter list: the socket receives no frames that would fill its buffer.
  if (setsockopt(socket->get(), SOL_CAN_RAW, CAN_RAW_FILTER, nullptr, 0) != 0)
    return core::Error{"CAN " + interface_name + ": receiving cannot be switched off; check the kernel"};
  core::Result<BoundCanSocket> bound = bind_can_socket(std::move(socket).value(), interface_name);
  if (!bound) return bound.error();
  return CanSender(bound->socket.release());
}

CanSender::CanSender(CanSender&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}

CanSender::~CanSender() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

CanSendResult CanSender::send(const CanFrame& frame) {
  const std::optional<KernelFrame> kernel = to_kernel_frame(frame);
  if (!kernel) return CanSendResult::kRefused;
  const ssize_t written = ::write(descriptor_, &kernel->frame, kernel->size);
  if (written == static_cast<ssize_t>(kernel->size)) return CanSendResult::kSent;
  if (errno == ENOBUFS || errno == EAGAIN || errno == EINTR) return CanSendResult::kQueueFull;
  if (errno == ENETDOWN || errno == ENODEV || errno == ENXIO) return CanSendResult::kDown;
  return CanSendResult::kRefused;
}

}  // namespace nilio::drivers
