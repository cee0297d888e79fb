#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/capture/pcap.hpp"

#include <functional>
#include <mutex>
#include <utility>

namespace nilio::drivers {
namespace {

using core::Error;

/// Problems reported in full; further ones are counted.
constexpr std::size_t kNotesKept = 3;

SourceStats operator+(const SourceStats& a, const SourceStats& b) {
  return {.delivered = a.delivered + b.delivered,
          .kernel_dropped = a.kernel_dropped + b.kernel_dropped,
          .malformed = a.malformed + b.malformed,
          .other = a.other + b.other};
}

template <class Slot>
class ChainedSource final : public Source<Slot> {
 public:
  using File = std::unique_ptr<Source<Slot>>;
  using Opener = std::function<core::Result<File>(const std::string&)>;

  ChainedSource(std::vector<std::string> paths, Opener opener)
      : paths_(std::move(paths)), opener_(std::move(opener)) {}

  SourceRead read(std::span<Slot> slots, core::Duration timeout) override {
    while (!is_over_ && (current_ || open_next())) {
      const SourceRead result = current_->read(slots, timeout);
      if (result.state != SourceState::kEnd && result.state != SourceState::kFailed) return result;
      // The last file stays open: closing it would block the reading thread.
      is_over_ =
          next_ == paths_.size() && result.state == SourceState::kEnd && current_->stats().malformed == 0;
      if (!is_over_) finish_current(result.state);
    }
    return {read_any_ || is_over_ ? SourceState::kEnd : SourceState::kFailed, 0};
  }

  [[nodiscard]] SourceStats stats() const override {
    const std::lock_guard lock(mutex_);
    return current_ ? finished_ + current_->stats() : finished_;
  }

  [[nodiscard]] std::string status() const override {
    const std::lock_guard lock(mutex_);
    if (paths_.size() == 1 && current_) return current_->status();
    if (paths_.size() == 1 && !last_status_.empty()) return last_status_;
    std::string text = std::to_string(finished_.delivered + (current_ ? current_->stats().delivered : 0)) +
                       " from " + std::to_string(paths_.size()) + " files, " + paths_.front() + " to " +
                       paths_.back();
    for (const std::string& note : notes_) text += "; " + note;
    if (further_notes_ > 0) text += "; " + std::to_string(further_notes_) + " more files with problems";
    return text + "; at " + (current_ ? current_->status() : last_status_);
  }

  /// False at the end of the list.
  bool open_next() {
    while (next_ < paths_.size()) {
      core::Result<File> opened = opener_(paths_[next_]);
      const std::lock_guard lock(mutex_);
      ++next_;
      if (opened) {
        current_ = std::move(opened).value();
        return true;
      }
      ++finished_.malformed;
      add_note(opened.error().message);
      last_status_ = opened.error().message;
    }
    return false;
  }

 private:
  void finish_current(SourceState state) {
    const std::lock_guard lock(mutex_);
    const SourceStats stats = current_->stats();
    last_status_ = current_->status();
    finished_ = finished_ + stats;
    if (state == SourceState::kFailed) ++finished_.malformed;
    if (state == SourceState::kFailed || stats.malformed > 0) add_note(last_status_);
    read_any_ = read_any_ || state == SourceState::kEnd || stats.delivered > 0;
    current_.reset();
  }

  void add_note(const std::string& note) {
    if (notes_.size() < kNotesKept) {
      notes_.push_back(note);
    } else {
      ++further_notes_;
    }
  }

  const std::vector<std::string> paths_;
  const Opener opener_;
  std::size_t next_ = 0;
  bool read_any_ = false;
  bool is_over_ = false;
  /// Guards the members below against status(); only the reading thread changes them, so it reads without the
  /// lock.
  mutable std::mutex mutex_;
  File current_;
  SourceStats finished_;
  std::vector<std::string> notes_;
  std::uint64_t further_notes_ = 0;
  std::string last_status_;
};

template <class Slot>
core::Result<std::unique_ptr<Source<Slot>>> chain(std::vector<std::string> paths,
                                                  typename ChainedSource<Slot>::Opener opener) {
  if (paths.empty()) return Error{"no files to read: name at least one"};
  auto source = std::make_unique<ChainedSource<Slot>>(std::move(paths), std::move(opener));
  // status() begins with the first problem.
  if (!source->open_next()) return Error{source->status()};
  return std::unique_ptr<Source<Slot>>(std::move(source));
}

}  // namespace

core::Result<std::unique_ptr<PacketSource>> chain_captures(std::vector<std::string> paths,
                                                           const PcapSourceConfig& config) {
  return chain<Packet>(std::move(paths),
                       [config](const std::string& path) { return open_pcap(path, config); });
}

core::Result<std::unique_ptr<FrameSource>> chain_can_captures(std::vector<std::string> paths,
                                                              const std::string& interface_name) {
  return chain<CanFrame>(std::move(paths), [interface_name](const std::string& path) {
    return open_can_capture(path, interface_name);
  });
}

core::Result<std::unique_ptr<FrameSource>> chain_can_logs(std::vector<std::string> paths,
                                                          const std::string& interface_name) {
  return chain<CanFrame>(std::move(paths), [interface_name](const std::string& path) {
    return open_candump(path, interface_name);
  });
}

}  // namespace nilio::drivers
