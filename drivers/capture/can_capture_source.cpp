#include "nilio/core/clock.hpp"
#include "nilio/drivers/can/can_files.hpp"

#include "drivers/capture/capture_source.hpp"

#include <array>
#include <charconv>
#include <optional>
#include <system_error>

namespace nilio::drivers {
namespace {

/// Name or number of an interface for status(), cut to Linux's length limit.
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

class CanCaptureSource final : public CaptureSource<CanFrame> {
 public:
  CanCaptureSource(std::unique_ptr<CaptureReader> reader, std::string path, std::string wanted)
      : CaptureSource(std::move(reader), std::move(path)), wanted_(std::move(wanted)) {
    std::uint32_t index = 0;
    const auto [end, code] = std::from_chars(wanted_.data(), wanted_.data() + wanted_.size(), index);
    if (code == std::errc{} && end == wanted_.data() + wanted_.size()) cooked_index_ = index;
  }

  [[nodiscard]] std::string status() const override;

 private:
  bool accept(const CapturedFrame& captured, CanFrame& slot) override;
  bool is_wanted(const CapturedFrame& captured, const CapturedCan& can);

  const std::string wanted_;
  /// For cooked captures: the wanted interface number, or that of the first frame.
  std::optional<std::uint32_t> cooked_index_;
  KeyCounter<Label, 16> seen_;
};

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
  slot.received_ns = monotonic_ns();
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

std::string CanCaptureSource::status() const {
  const SourceStats stats = counters_.read();
  std::string text = path_ + ": " + std::to_string(stats.delivered) + " CAN frames";
  const std::string seen = seen_.describe(
      [](const Label& label, std::uint64_t count) { return std::to_string(count) + " of " + label.data(); });
  if (!seen.empty()) text += ", in the file " + seen;
  if (!wanted_.empty() && !seen.empty()) text += ", wanted '" + wanted_ + "'";
  if (stats.malformed > 0) text += "; " + std::to_string(stats.malformed) + " malformed";
  if (state() == SourceState::kEnd && stats.delivered == 0) {
    text += seen.empty() ? "; it has no CAN frames, record with 'dumpcap -i can0' or 'tcpdump -i any'"
                         : "; set the CAN interface to one of these, or leave it empty";
  }
  return with_end_reason(text);
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
  constexpr int kRecordsToCheck = 20'000;
  const core::Result<std::unique_ptr<CaptureReader>> reader = open_capture(path, CaptureContent::kCan);
  if (!reader) return false;
  CapturedFrame frame;
  for (int i = 0; i < kRecordsToCheck; ++i) {
    const CaptureRead result = (*reader)->next(frame);
    if (result == CaptureRead::kSkipped) continue;
    if (result != CaptureRead::kFrame) return false;
    if (find_can_frame(frame.link_type, frame.bytes, frame.big_endian_host).kind == CapturedCan::Kind::kCan)
      return true;
  }
  return false;
}

}  // namespace nilio::drivers
