#include "ipc/dds/topic_conflicts.hpp"

#include "ipc/dds/odometry_publisher.hpp"
#include "ipc/dds/odometry_subscriber.hpp"
#include "tests/support/dds_support.hpp"

#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <catch2/catch.hpp>

namespace {

using Catch::Matchers::Contains;
using namespace nilio::dds;
using namespace nilio::tests;

std::unique_ptr<OdometryPublisher> publisher_of(std::uint32_t domain, const std::string& prefix,
                                                const std::string& base_frame, bool transform = true) {
  OdometryPublisherConfig config;
  config.transform = transform;
  config.participant = loopback(domain);
  config.participant.name = "vehicle \n2";
  config.topic_prefix = prefix;
  config.base_frame = base_frame;
  auto publisher = OdometryPublisher::create(config);
  if (!publisher) FAIL(publisher.error().message);
  return std::move(publisher).value();
}

}  // namespace

TEST_CASE("a second nilio on the same topics is named to both, once for each topic", "[topic_conflicts]") {
  const std::uint32_t domain = test_domain();
  const auto first = make_publisher(domain);
  const auto second = publisher_of(domain, "", "base_link");
  for (OdometryPublisher* publisher : {first.get(), second.get()}) {
    std::vector<std::string> lines;
    REQUIRE(eventually([&] {
      for (std::string& line : publisher->participant().take_conflicts()) lines.push_back(std::move(line));
      return lines.size() >= 2;
    }));
    std::string all;
    for (const std::string& line : lines) all += line + "\n";
    CHECK_THAT(all, Contains("rt/odom: poses are also published by \"") &&
                        Contains("rt/tf: the transform of base_link is also published by \"") &&
                        Contains("on this machine (GUID 01.0f.") && Contains("stop one of them") &&
                        Contains("publisher.domain") && Contains("publisher.topic_prefix"));
    std::this_thread::sleep_for(std::chrono::milliseconds(500));
    CHECK(publisher->participant().take_conflicts().empty());
    if (publisher == first.get()) CHECK_THAT(all, Contains("\"vehicle ?2\""));
  }
}

TEST_CASE("nilio on other topics conflicts only if it moves the same frame", "[topic_conflicts]") {
  const std::uint32_t domain = test_domain();
  const auto first = make_publisher(domain);
  const auto third = publisher_of(domain, "other", "trailer_link");
  std::this_thread::sleep_for(std::chrono::seconds(1));
  CHECK(first->participant().take_conflicts().empty());
  CHECK(third->participant().take_conflicts().empty());
  const auto second = publisher_of(domain, "another", "base_link");
  std::vector<std::string> lines;
  REQUIRE(eventually([&] {
    lines = first->participant().take_conflicts();
    return !lines.empty();
  }));
  CHECK(lines.size() == 1);
  CHECK_THAT(lines.front(), Contains("rt/tf: the transform of base_link"));
}

TEST_CASE("nilio without the transform publishes its poses and moves no frame", "[topic_conflicts]") {
  const std::uint32_t domain = test_domain();
  const auto first = make_publisher(domain);
  const auto second = publisher_of(domain, "other", "base_link", false);
  auto subscriber = OdometrySubscriber::create({.participant = loopback(domain), .topic_prefix = "other"});
  REQUIRE(subscriber.ok());
  REQUIRE(wait_for_subscriber(*second));
  CHECK(second->publish_odometry(sample_record(1)));
  CHECK(second->publish_transform(sample_record(1)));
  CHECK((*subscriber)->next(kPatience).has_value());
  CHECK(second->wait_for_pose_acknowledgments(kPatience));
  CHECK(first->participant().take_conflicts().empty());
  CHECK(second->participant().take_conflicts().empty());
}
