#include "tools/bench/common/pose_listener.hpp"

#include "nilio/core/clock.hpp"

#include "ipc/dds/reports.hpp"
#include "tools/common/system.hpp"

#include <utility>

namespace nilio::tools::bench {

core::Result<std::unique_ptr<PoseListener>> PoseListener::start(std::uint32_t domain) {
  dds::OdometrySubscriberConfig config;
  config.participant.domain = domain;
  config.participant.interface_whitelist = {"127.0.0.1"};
  config.participant.name = "nilio bench";
  auto subscriber = dds::OdometrySubscriber::create(config);
  if (!subscriber) return subscriber.error();
  return std::unique_ptr<PoseListener>(new PoseListener(std::move(subscriber).value()));
}

PoseListener::PoseListener(std::unique_ptr<dds::OdometrySubscriber> subscriber)
    : subscriber_(std::move(subscriber)), packet_to_pose_(dds::read_host_id()), thread_([this] { run(); }) {}

void PoseListener::stop() {
  stop_.store(true);
  if (thread_.joinable()) thread_.join();
}

void PoseListener::run() {
  while (!stop_.load(std::memory_order_relaxed)) {
    const auto sample = subscriber_->next(kPoll);
    for (const dds::ScanReport& report : subscriber_->scan_reports()) packet_to_pose_.add_report(report);
    if (!sample) continue;
    packet_to_pose_.add_pose(sample->message.stamp, sample->received_ns);
    transport_->record((sample->received - sample->written).ns);
    poses_.fetch_add(1);
    last_pose_ns_.store(monotonic_ns());
  }
}

}  // namespace nilio::tools::bench
