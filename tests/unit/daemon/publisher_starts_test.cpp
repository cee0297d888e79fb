#include "daemon/supervision/publisher_starts.hpp"

#include <string>

#include <catch2/catch.hpp>

using namespace nilio;
using daemon::LogLevel;
using daemon::PublisherStarts;
using Kind = ipc::ProcessEvent::Kind;

namespace {

ipc::PublisherEvent event(Kind kind, int exit_status, const std::string& message) {
  ipc::PublisherEvent result;
  result.kind = kind;
  result.exit_status = exit_status;
  result.message = message;
  return result;
}

}  // namespace

TEST_CASE("a publisher that never starts is one error, however often it is tried", "[publisher_starts]") {
  const bool exits = GENERATE(false, true);
  const Kind kind = exits ? Kind::kDied : Kind::kStartFailed;
  PublisherStarts starts;
  CHECK(starts.failure().empty());
  const auto first =
      starts.observe(event(kind, 1, "publisher 7 ended with status 1, next start in 990 ms"), 0);
  REQUIRE(first.has_value());
  CHECK(first->level == LogLevel::kError);
  CHECK(first->text.find("publisher 7 ended with status 1; poses continue without DDS") == 0);
  for (int i = 0; i < 5; ++i) {
    CHECK_FALSE(starts.observe(event(Kind::kStarted, -1, "started again"), 0).has_value());
    CHECK_FALSE(starts.observe(event(kind, 1, "the same"), 0).has_value());
    CHECK_FALSE(starts.observe(0).has_value());
  }
  CHECK(starts.failure() == "the same");
}

TEST_CASE("a publisher that starts after failures is reported and counts as running", "[publisher_starts]") {
  PublisherStarts starts;
  starts.observe(event(Kind::kStartFailed, -1, "no such file"), 0);
  starts.observe(event(Kind::kStarted, -1, "started again"), 0);
  const auto line = starts.observe(3);
  REQUIRE(line.has_value());
  CHECK(line->level == LogLevel::kInfo);
  CHECK(line->text == "publisher runs after 1 failed starts");
  CHECK(starts.failure().empty());
  CHECK_FALSE(starts.observe(4).has_value());
}

TEST_CASE("a publisher that dies after it ran is a warning, and each restart a line", "[publisher_starts]") {
  PublisherStarts starts;
  const auto died = starts.observe(event(Kind::kDied, -1, "killed"), 12);
  REQUIRE(died.has_value());
  CHECK(died->level == LogLevel::kWarning);
  const auto started = starts.observe(event(Kind::kStarted, -1, "started again"), 12);
  REQUIRE(started.has_value());
  CHECK(started->level == LogLevel::kInfo);
  CHECK(starts.failure().empty());
}

TEST_CASE("a publisher that is stopped before it began is no failed start", "[publisher_starts]") {
  PublisherStarts starts;
  CHECK_FALSE(starts.observe(event(Kind::kStopped, -1, "killed by SIGKILL"), 0).has_value());
  CHECK(starts.failure().empty());
  // It had ended by itself.
  CHECK(starts.observe(event(Kind::kStopped, 1, "ended with status 1"), 0)->level == LogLevel::kError);
  CHECK(starts.failure() == "ended with status 1");
}
