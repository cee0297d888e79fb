#pragma once

#include "nilio/drivers/capture/capture_reader.hpp"
#include "nilio/drivers/source.hpp"

#include "drivers/common/counters.hpp"

#include <atomic>
#include <memory>
#include <mutex>
#include <span>
#include <string>

namespace nilio::drivers {

/// A capture file as a source: reads records until the slots are full and keeps the reason of an early end. A
/// subclass selects the records. One thread calls read(); stats() and status() may be called from another.
template <class Slot>
class CaptureSource : public Source<Slot> {
 public:
  CaptureSource(std::unique_ptr<CaptureReader> reader, std::string path)
      : path_(std::move(path)), reader_(std::move(reader)) {}

  SourceRead read(std::span<Slot> slots, core::Duration /*timeout*/) final {
    std::size_t count = 0;
    while (count < slots.size() && state() == SourceState::kData) {
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
    return {state(), 0};
  }
  [[nodiscard]] SourceStats stats() const final { return counters_.read(); }

 protected:
  /// Fills `slot` and returns true for a wanted record; counts any other.
  virtual bool accept(const CapturedFrame& frame, Slot& slot) = 0;

  [[nodiscard]] SourceState state() const { return state_.load(std::memory_order_relaxed); }
  /// `text`, followed by the reason when the source ended before the end of the file.
  [[nodiscard]] std::string with_end_reason(const std::string& text) const {
    const std::lock_guard lock(end_mutex_);
    return end_reason_.empty() ? text : text + "; " + end_reason_;
  }

  const std::string path_;
  SourceCounters counters_;

 private:
  void end(CaptureRead how) {
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

  std::unique_ptr<CaptureReader> reader_;
  std::atomic<SourceState> state_{SourceState::kData};
  /// Written once, before `state_`.
  mutable std::mutex end_mutex_;
  std::string end_reason_;
};

}  // namespace nilio::drivers
