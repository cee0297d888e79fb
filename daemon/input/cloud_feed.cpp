#include "daemon/input/cloud_feed.hpp"

#include <algorithm>
#include <chrono>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace nilio::daemon {

core::Result<std::unique_ptr<CloudScanFeed>> CloudScanFeed::create(
    std::unique_ptr<drivers::CloudSource> clouds, const std::string& name, drivers::PointTimes times) {
  std::vector<drivers::CloudCopy> head;
  drivers::CloudView view;
  while (head.size() < drivers::CloudDecoder::kSamples && clouds->next(view)) head.emplace_back(view);
  if (head.empty()) return core::Error{name + ": no cloud can be decoded"};
  auto decoder = drivers::CloudDecoder::create(head, name, times);
  if (!decoder) return decoder.error();
  std::deque<drivers::CloudCopy> queue(std::make_move_iterator(head.begin()),
                                       std::make_move_iterator(head.end()));
  std::unique_ptr<CloudScanFeed> feed(
      new CloudScanFeed(std::move(clouds), name, std::move(queue), std::move(decoder).value()));
  feed->has_held_ = feed->load(feed->held_);
  if (!feed->has_held_) return core::Error{name + ": no cloud has a return"};
  feed->first_stamp_ = feed->held_.end;
  return feed;
}

CloudScanFeed::CloudScanFeed(std::unique_ptr<drivers::CloudSource> clouds, std::string name,
                             std::deque<drivers::CloudCopy> head, drivers::CloudDecoder decoder)
    : clouds_(std::move(clouds)),
      name_(std::move(name)),
      head_(std::move(head)),
      decoder_(std::move(decoder)) {}

bool CloudScanFeed::load(core::Scan& scan) {
  for (;;) {
    bool is_usable = false;
    if (!head_.empty()) {
      is_usable = decoder_.decode(head_.front().view, scan);
      head_.pop_front();
    } else {
      if (!clouds_->next(view_)) return false;
      is_usable = decoder_.decode(view_, scan);
    }
    if (!is_usable || (last_end_ && scan.end <= *last_end_)) {
      ++stats_.partial_scans;
      continue;
    }
    last_end_ = scan.end;
    scan.sequence = sequence_++;
    ++stats_.scans;
    stats_.points += scan.points.size();
    return true;
  }
}

std::vector<std::string> CloudScanFeed::skipped() const {
  std::vector<std::string> lines = clouds_->notes();
  if (clouds_->damaged() > 0)
    lines.push_back(name_ + ": " + std::to_string(clouds_->damaged()) + " damaged clouds are skipped");
  if (decoder_.stray_points() > 0)
    lines.push_back(name_ + ": " + std::to_string(decoder_.stray_points()) +
                    " points with times outside of their sweep are skipped");
  return lines;
}

FeedState CloudScanFeed::next(core::Scan& scan, core::Duration timeout) {
  if (!has_held_ && !(has_held_ = load(held_))) return FeedState::kEnd;
  if (start_ns_) {
    const std::int64_t left = *start_ns_ + (held_.end - *first_stamp_).ns - monotonic_ns();
    if (left > 0) std::this_thread::sleep_for(std::chrono::nanoseconds(std::min(left, timeout.ns)));
    if (left > timeout.ns) return FeedState::kIdle;
  }
  std::swap(scan, held_);
  has_held_ = false;
  scan.received_ns = scan.popped_ns = scan.completed_ns = monotonic_ns();
  return FeedState::kScan;
}

}  // namespace nilio::daemon
