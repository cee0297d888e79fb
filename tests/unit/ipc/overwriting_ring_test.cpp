#include "ipc/overwriting_ring.hpp"

#include "ipc/scan_cloud.hpp"

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <thread>

#include <catch2/catch.hpp>

namespace {

using nilio::ipc::OverwritingRing;

struct Item {
  std::array<std::uint64_t, 64> words{};
};

Item make_item(std::uint64_t value) {
  Item item;
  item.words.fill(value);
  return item;
}

bool is_intact(const Item& item) {
  for (const std::uint64_t word : item.words) {
    if (word != item.words[0]) return false;
  }
  return true;
}

OverwritingRing<Item> make_ring(std::size_t capacity) {
  auto ring = OverwritingRing<Item>::in_shared_memory(capacity);
  REQUIRE(ring.ok());
  return std::move(ring).value();
}

OverwritingRing<Item> attach(const OverwritingRing<Item>& ring) {
  auto attached = OverwritingRing<Item>::attach(ring.file_descriptor());
  REQUIRE(attached.ok());
  return std::move(attached).value();
}

}  // namespace

TEST_CASE("values are read in order until the producer overwrites the oldest, which are counted",
          "[overwriting_ring]") {
  auto producer = make_ring(4);
  auto consumer = attach(producer);
  Item item;
  CHECK_FALSE(consumer.read(item));
  for (std::uint64_t i = 0; i < 3; ++i) producer.push(make_item(i));
  CHECK_FALSE(producer.has_room());
  for (std::uint64_t i = 0; i < 3; ++i) {
    REQUIRE(consumer.read(item));
    CHECK(item.words[0] == i);
  }
  CHECK(producer.has_room());
  CHECK(producer.dropped() == 0);
  for (std::uint64_t i = 3; i < 10; ++i) producer.push(make_item(i));
  REQUIRE(consumer.read(item));
  CHECK(item.words[0] == 7);  // three of four slots are readable
  CHECK(producer.dropped() == 4);
  producer.push(make_item(10));
  producer.push(make_item(11));
  REQUIRE(consumer.read_newest(item));
  CHECK(item.words[0] == 11);
  CHECK(producer.dropped() == 7);
  CHECK_FALSE(consumer.read_newest(item));
  CHECK(producer.taken() == 12);
}

TEST_CASE("a consumer that replaces another continues where that one stopped, or goes back to the oldest",
          "[overwriting_ring]") {
  auto producer = make_ring(8);
  for (std::uint64_t i = 0; i < 5; ++i) producer.push(make_item(i));
  Item item;
  {
    auto first = attach(producer);
    REQUIRE(first.read(item));
    REQUIRE(first.read(item));
  }
  auto second = attach(producer);
  REQUIRE(second.read(item));
  CHECK(item.words[0] == 2);
  second.rewind();
  REQUIRE(second.read(item));
  CHECK(item.words[0] == 0);
  second.skip_all();
  CHECK_FALSE(second.read(item));
  CHECK(producer.dropped() == 0);
}

TEST_CASE("only the used part of a value is transferred", "[overwriting_ring]") {
  auto ring = OverwritingRing<nilio::ipc::ScanCloud>::in_shared_memory(2);
  REQUIRE(ring.ok());
  auto consumer = OverwritingRing<nilio::ipc::ScanCloud>::attach(ring->file_descriptor());
  REQUIRE(consumer.ok());
  const auto written = std::make_unique<nilio::ipc::ScanCloud>();
  written->count = 2;
  written->points[1] = {1.0F, 2.0F, 3.0F, 4.0F};
  written->points[2].x = 5.0F;
  ring->push(*written, written->bytes());
  const auto read = std::make_unique<nilio::ipc::ScanCloud>();
  REQUIRE(consumer->read(*read));
  CHECK(read->count == 2);
  CHECK(read->points[1].intensity == 4.0F);
  CHECK(read->points[2].x == 0.0F);
}

TEST_CASE("a value that changes while it is copied is never returned", "[overwriting_ring]") {
  auto producer = make_ring(2);
  auto consumer = attach(producer);
  std::atomic<bool> stop{false};
  std::thread writer([&] {
    for (std::uint64_t i = 0; i < 300'000; ++i) producer.push(make_item(i));
    stop.store(true);
  });
  std::uint64_t read = 0;
  std::uint64_t last = 0;
  bool intact = true;
  bool ordered = true;
  Item item;
  while (!stop.load()) {
    if (!consumer.read(item)) continue;
    intact = intact && is_intact(item);
    ordered = ordered && (read == 0 || item.words[0] > last);
    last = item.words[0];
    ++read;
  }
  writer.join();
  while (consumer.read(item)) ++read;
  CHECK(intact);
  CHECK(ordered);
  CHECK(read + producer.dropped() == 300'000);
}

TEST_CASE("memory of another kind is not attached", "[overwriting_ring]") {
  const auto ring = make_ring(2);
  using Catch::Matchers::Contains;
  const auto other = OverwritingRing<nilio::ipc::ScanCloud>::attach(ring.file_descriptor());
  REQUIRE_FALSE(other.ok());
  CHECK_THAT(other.error().message, Contains("matching programs"));
  CHECK_FALSE(OverwritingRing<Item>::attach(0).ok());
}
