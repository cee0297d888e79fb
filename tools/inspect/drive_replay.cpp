#include "tools/inspect/drive_replay.hpp"

#include "tools/common/system.hpp"

#include <atomic>
#include <memory>
#include <span>
#include <utility>

namespace nilio::tools::inspect {

namespace {

/// Ends a recording early, at a stamp, so that the result is reproducible.
class ShortenedSource : public drivers::PacketSource {
 public:
  ShortenedSource(std::unique_ptr<drivers::PacketSource> source, core::Time end)
      : source_(std::move(source)), end_(end) {}

  drivers::SourceRead read(std::span<drivers::Packet> slots, core::Duration timeout) override {
    if (shortened_.load()) return {drivers::SourceState::kEnd, 0};
    drivers::SourceRead result = source_->read(slots, timeout);
    for (std::size_t i = 0; i < result.count; ++i) {
      if (slots[i].stamp < end_) continue;
      shortened_.store(true);
      return {i > 0 ? drivers::SourceState::kData : drivers::SourceState::kEnd, i};
    }
    return result;
  }
  [[nodiscard]] drivers::SourceStats stats() const override { return source_->stats(); }
  [[nodiscard]] std::string status() const override { return source_->status(); }
  [[nodiscard]] bool was_shortened() const { return shortened_.load(); }

 private:
  std::unique_ptr<drivers::PacketSource> source_;
  core::Time end_;
  std::atomic<bool> shortened_{false};
};

/// Shortens all LiDARs; returns the first one's source, null without packets.
const ShortenedSource* shorten(daemon::Input& input, double seconds) {
  if (!input.packets || !input.first_stamp) return nullptr;
  const core::Time end = *input.first_stamp + core::Duration::from_seconds(seconds);
  auto first = std::make_unique<ShortenedSource>(std::move(input.packets), end);
  const ShortenedSource* const result = first.get();
  input.packets = std::move(first);
  for (daemon::ExtraLidar& lidar : input.more_lidars)
    lidar.packets = std::make_unique<ShortenedSource>(std::move(lidar.packets), end);
  return result;
}

}  // namespace

core::Result<bool> replay_drive(const daemon::Config& config, daemon::Input input,
                                const DriveReplay& replay) {
  const ShortenedSource* const source = shorten(input, replay.seconds);
  daemon::PipelineOptions options;
  options.observer = replay.observer;
  auto created = daemon::Pipeline::create(config, std::move(input), options, nullptr);
  if (!created) return created.error();
  daemon::Pipeline& pipeline = **created;
  if (const auto started = pipeline.start(); !started) return started.error();
  while (!pipeline.finished()) {
    pipeline.output_event().wait(kPoll);
    if (replay.drain) replay.drain(pipeline);
  }
  pipeline.join();
  if (replay.drain) replay.drain(pipeline);
  return source != nullptr && source->was_shortened();
}

}  // namespace nilio::tools::inspect
