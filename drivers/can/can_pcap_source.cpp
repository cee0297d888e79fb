#include "nilio/drivers/can/can_capture.hpp"
#include "nilio/drivers/capture/capture_reader.hpp"

#include "drivers/can/can_in_frame.hpp"
#include "drivers/common/key_counter.hpp"
#include "drivers/common/source_support.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <optional>
#include <system_error>

namespace nilio::drivers {
namespace {

/// An interface for status(): its name or number, cut to what Linux allows.
using Label = std::array<char, 16>;

Label label_of(std::string_view name) {
  Label label{};
  std::size_t length = 0;
  for (const char c : name.substr(0, label.size() - 1)) label[length++] = c >= ' ' && c < '\x7F' ? c : '?';
  return label;
}

Label label_of(std::uint32_t index) {
  Label label{'#'};
  std::to_chars(label.data() + 1, label.data() + label.size() - 1, index);
  return label;
}

class CanCaptureSource final : public FrameSource {
 public:
  CanCaptureSource(std::unique_ptr<CaptureReader> reader, std::string path, std::string wanted)
      : reader_(std::move(reader)), path_(std::move(path)), wanted_(std::move(wanted)) {
    std::uint32_t index = 0;
    const auto [end, code] = std::from_chars(wanted_.data(), wanted_.data() + wanted_.size(), index);
    if (code == std::errc{} && end == wanted_.data() + wanted_.size()) cooked_index_ = index;
  }

  SourceRead read(std::span<CanFrame> slots, core::Duration timeout) override;
  [[nodiscard]] SourceStats stats() const override { return counters_.read(); }
  [[nodiscard]] std::string status() const override;

 private:
  bool accept(const CapturedFrame& captured, CanFrame& slot);
  bool is_wanted(const CapturedFrame& captured, const CapturedCan& can);
  void end(CaptureRead how);

  std::unique_ptr<CaptureReader> reader_;
  const std::string path_;
  const std::string wanted_;
  /// Of cooked captures: the number wanted, or that of the first frame.
  std::optional<std::uint32_t> cooked_index_;
  SourceCounters counters_;
  KeyCounter<Label, 16> seen_;
  std::atomic<SourceState> state_{SourceState::kData};
  mutable std::mutex end_mutex_;
  std::string end_reason_;
};

SourceRead CanCaptureSource::read(std::span<CanFrame> slots, core::Duration /*timeout*/) {
  std::size_t count = 0;
  while (count < slots.size() && state_.load(std::memory_order_relaxed) == SourceState::kData) {
    CapturedFrame frame;
    const CaptureRead result = reader_->next(frame);
    if (result == CaptureRead::kFrame) {
      if (accept(frame, slots[count])) ++count;
    } else if (result == CaptureRead::kSkipped) {
      counters_.add_malformed(1);
    } else {
      end(result);
    }
  }
  counters_.add_delivered(count);
  if (count > 0 || slots.empty()) return {SourceState::kData, count};
  return {state_.load(std::memory_order_relaxed), 0};
}

bool CanCaptureSource::accept(const CapturedFrame& captured, CanFrame& slot) {
  const CapturedCan can = find_can_frame(captured.link_type, captured.bytes, captured.big_endian_host);
  if (can.kind == CapturedCan::Kind::kMalformed) {
    counters_.add_malformed(1);
    return false;
  }
  if (can.kind == CapturedCan::Kind::kOther || !is_wanted(captured, can)) {
    counters_.add_other(1);
    return false;
  }
  slot = can.frame;
  slot.stamp.ns = captured.stamp_ns;
  slot.received_ns = clock_ns(CLOCK_MONOTONIC);
  return true;
}

bool CanCaptureSource::is_wanted(const CapturedFrame& captured, const CapturedCan& can) {
  if (is_cooked_link_type(captured.link_type)) {
    seen_.count(label_of(can.interface_index));
    if (wanted_.empty()) return true;
    if (!cooked_index_) cooked_index_ = can.interface_index;
    return *cooked_index_ == can.interface_index;
  }
  if (captured.interface_name.empty()) return true;
  seen_.count(label_of(captured.interface_name));
  return wanted_.empty() || captured.interface_name == wanted_;
}

void CanCaptureSource::end(CaptureRead how) {
  if (how == CaptureRead::kTruncated) {
    counters_.add_malformed(1);
    const std::lock_guard lock(end_mutex_);
    end_reason_ =
        "the file ends in the middle of a packet (recording not closed properly, or copied in part); "
        "everything before was read";
  } else if (how == CaptureRead::kDamaged) {
    const std::lock_guard lock(end_mutex_);
    end_reason_ = reader_->problem();
  }
  state_.store(how == CaptureRead::kDamaged ? SourceState::kFailed : SourceState::kEnd,
               std::memory_order_relaxed);
}

std::string CanCaptureSource::status() const {
  const SourceStats stats = counters_.read();
  std::string text = path_ + ": " + std::to_string(stats.delivered) + " CAN frames";
  const std::string seen = seen_.describe(
      [](const Label& label, std::uint64_t count) { return std::to_string(count) + " of " + label.data(); });
  if (!seen.empty()) text += ", in the file " + seen;
  if (!wanted_.empty() && !seen.empty()) text += ", wanted '" + wanted_ + "'";
  if (stats.malformed > 0) text += "; " + std::to_string(stats.malformed) + " malformed";
  const bool ended = state_.load(std::memory_order_relaxed) == SourceState::kEnd;
  if (ended && stats.delivered == 0) {
    text += seen.empty() ? "; it has no CAN frames, record with 'dumpcap -i can0' or 'tcpdump -i any'"
                         : "; set the CAN interface to one of these, or leave it empty";
  }
  const std::lock_guard lock(end_mutex_);
  return end_reason_.empty() ? text : text + "; " + end_reason_;
}

}  // namespace

core::Result<std::unique_ptr<FrameSource>> open_can_capture(const std::string& path,
                                                            const std::string& interface_name) {
  core::Result<std::unique_ptr<CaptureReader>> reader = open_capture(path, CaptureContent::kCan);
  if (!reader) return reader.error();
  return std::unique_ptr<FrameSource>(
      std::make_unique<CanCaptureSource>(std::move(reader).value(), path, interface_name));
}

bool has_can_frames(const std::string& path) {
  constexpr int kRecordsToLookAt = 20'000;
  const core::Result<std::unique_ptr<CaptureReader>> reader = open_capture(path, CaptureContent::kCan);
  if (!reader) return false;
  CapturedFrame frame;
  for (int i = 0; i < kRecordsToLookAt; ++i) {
    const CaptureRead result = (*reader)->next(frame);
    if (result == CaptureRead::kSkipped) continue;
    if (result != CaptureRead::kFrame) return false;
    if (find_can_frame(frame.link_type, frame.bytes, frame.big_endian_host).kind == CapturedCan::Kind::kCan)
      return true;
  }
  return false;
}

}  // namespace nilio::drivers
