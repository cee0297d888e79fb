#include "ipc/ring.hpp"

#include "ipc/wake_event.hpp"

#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstring>
#include <fcntl.h>
#include <numeric>
#include <random>
#include <sys/mman.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

#include <catch2/catch.hpp>

namespace {

using nilio::ipc::Ring;
using nilio::ipc::RingHeader;

struct Item {
  std::uint64_t value = 0;
  std::array<std::uint64_t, 5> payload{};
  std::uint64_t checksum = 0;
};

Item make_item(std::uint64_t value) {
  Item item;
  item.value = value;
  for (std::size_t i = 0; i < item.payload.size(); ++i) item.payload[i] = value * 0x9E37'79B9'7F4A'7C15U + i;
  item.checksum = std::accumulate(item.payload.begin(), item.payload.end(), value);
  return item;
}

bool is_intact(const Item& item) {
  return item.checksum == std::accumulate(item.payload.begin(), item.payload.end(), item.value);
}

// Header of a shared ring as a misbehaving process could write it.
class RawHeader {
 public:
  explicit RawHeader(int file_descriptor)
      : header_(static_cast<RingHeader*>(
            mmap(nullptr, sizeof(RingHeader), PROT_READ | PROT_WRITE, MAP_SHARED, file_descriptor, 0))) {
    REQUIRE(header_ != MAP_FAILED);
  }
  ~RawHeader() { munmap(header_, sizeof(RingHeader)); }
  RawHeader(const RawHeader&) = delete;
  RawHeader& operator=(const RawHeader&) = delete;
  RingHeader* operator->() { return header_; }

 private:
  RingHeader* header_;
};

}  // namespace

TEST_CASE("capacity is rounded up to a power of two", "[ring]") {
  CHECK(Ring<int>::in_private_memory(0).capacity() == 1);
  CHECK(Ring<int>::in_private_memory(1).capacity() == 1);
  CHECK(Ring<int>::in_private_memory(5).capacity() == 8);
  CHECK(Ring<int>::in_private_memory(4096).capacity() == 4096);
}

TEST_CASE("values keep their order over many times the capacity", "[ring]") {
  auto ring = Ring<std::uint64_t>::in_private_memory(8);
  std::uint64_t expected = 0;
  for (std::uint64_t i = 0; i < 1000; ++i) {
    REQUIRE(ring.try_push(2 * i));
    REQUIRE(ring.try_push(2 * i + 1));
    REQUIRE(ring.try_pop() == expected++);
    REQUIRE(ring.try_pop() == expected++);
  }
  CHECK(ring.size() == 0);
  CHECK_FALSE(ring.try_pop().has_value());
  CHECK(ring.high_water() == 2);
  CHECK(ring.written() == 2000);
  CHECK(ring.consumed() == 2000);
}

TEST_CASE("a full ring drops the newest value and counts it", "[ring]") {
  auto ring = Ring<int>::in_private_memory(4);
  for (int i = 0; i < 7; ++i) CHECK(ring.try_push(i) == (i < 4));
  CHECK(ring.dropped() == 3);
  CHECK(ring.size() == 4);
  CHECK(ring.high_water() == 4);
  CHECK(ring.try_pop() == 0);
  CHECK(ring.try_push(9));
  CHECK(ring.try_pop() == 1);
}

TEST_CASE("write spans end at the wrap and at the oldest unread slot", "[ring]") {
  auto ring = Ring<int>::in_private_memory(8);
  CHECK(ring.begin_write(100).size() == 8);
  ring.commit(6);
  CHECK(ring.begin_read().size() == 6);
  ring.consume(5);
  CHECK(ring.begin_write(100).size() == 2);  // up to the wrap
  ring.commit(2);
  CHECK(ring.begin_write(100).size() == 5);  // up to the unread slot
  CHECK(ring.begin_write(3).size() == 3);
  ring.commit(0);
  CHECK(ring.size() == 3);
}

TEST_CASE("spans are written and read in place", "[ring]") {
  auto ring = Ring<int>::in_private_memory(4);
  const auto free = ring.begin_write(3);
  std::iota(free.begin(), free.end(), 10);
  const int* const place = free.data();
  ring.commit(2);
  const auto filled = ring.begin_read();
  REQUIRE(filled.size() == 2);
  CHECK(filled.data() == place);
  CHECK(filled[0] == 10);
  CHECK(filled[1] == 11);
}

TEST_CASE("at most the granted slots are committed and consumed", "[ring]") {
  auto ring = Ring<int>::in_private_memory(4);
  CHECK(ring.begin_write(2).size() == 2);
  ring.commit(1000);
  CHECK(ring.size() == 2);
  ring.commit(1);
  CHECK(ring.size() == 2);
  CHECK(ring.begin_read().size() == 2);
  ring.consume(1000);
  ring.consume(1);
  CHECK(ring.consumed() == 2);
  CHECK(ring.size() == 0);
}

TEST_CASE("two threads with random stalls exchange every value intact and in order", "[ring]") {
  constexpr std::uint64_t item_count = 200'000;
  auto ring = Ring<Item>::in_private_memory(64);
  std::thread producer([&ring] {
    std::minstd_rand random(1);
    std::uint64_t next = 0;
    while (next < item_count) {
      const auto slots = ring.begin_write(1 + random() % 16);
      std::size_t count = 0;
      for (Item& slot : slots) {
        if (next == item_count) break;
        slot = make_item(next++);
        ++count;
      }
      ring.commit(count);
      if (count == 0 || random() % 4096 == 0) std::this_thread::yield();
    }
  });
  std::minstd_rand random(2);
  std::uint64_t expected = 0;
  std::uint64_t wrong = 0;
  while (expected < item_count) {
    const auto slots = ring.begin_read();
    for (const Item& item : slots) wrong += item.value == expected++ && is_intact(item) ? 0U : 1U;
    ring.consume(slots.size());
    if (slots.empty() || random() % 4096 == 0) std::this_thread::yield();
  }
  producer.join();
  CHECK(wrong == 0);
  CHECK(ring.size() == 0);
  CHECK(ring.high_water() <= ring.capacity());
}

TEST_CASE("a third thread reads size and counters while two others run", "[ring]") {
  auto ring = Ring<std::uint64_t>::in_private_memory(16);
  std::atomic<bool> done{false};
  std::atomic<std::uint64_t> too_large{0};
  std::thread observer([&] {
    while (!done) {
      if (ring.size() > ring.capacity() || ring.high_water() > ring.capacity()) ++too_large;
    }
  });
  std::thread producer([&] {
    for (std::uint64_t i = 0; i < 50'000;) {
      if (ring.try_push(i))
        ++i;
      else
        std::this_thread::yield();
    }
  });
  for (std::uint64_t popped = 0; popped < 50'000;) {
    if (ring.try_pop())
      ++popped;
    else
      std::this_thread::yield();
  }
  producer.join();
  done = true;
  observer.join();
  CHECK(too_large == 0);
}

TEST_CASE("a reader killed with SIGKILL is replaced by one that continues at the same slot", "[ring]") {
  constexpr std::uint64_t item_count = 60'000;
  auto ring = Ring<Item>::in_shared_memory(256);
  REQUIRE(ring.ok());
  // Each reader checks the order from its first slot and reports progress and errors in shared memory.
  struct Report {
    std::atomic<std::uint64_t> next{0};
    std::atomic<std::uint64_t> wrong{0};
  };
  auto* report =
      new (mmap(nullptr, sizeof(Report), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0)) Report;
  const auto start_reader = [&] {
    const pid_t pid = fork();
    REQUIRE(pid >= 0);
    if (pid > 0) return pid;
    auto attached = Ring<Item>::attach(ring->file_descriptor());
    if (!attached) _exit(1);
    while (report->next < item_count) {
      const auto slots = attached->begin_read();
      if (slots.empty()) {
        std::this_thread::yield();
        continue;
      }
      // After a kill between these two lines, the next reader sees the value again and misses none.
      const std::uint64_t value = slots.front().value;
      if (!is_intact(slots.front()) || value > report->next || value + 1 < report->next) ++report->wrong;
      report->next = value + 1;
      attached->consume(1);
    }
    _exit(0);
  };

  pid_t reader = start_reader();
  int kills = 0;
  for (std::uint64_t i = 0; i < item_count;) {
    if (ring->try_push(make_item(i))) {
      ++i;
    } else {
      std::this_thread::yield();
    }
    if (i % 5000 == 2500 && kills < static_cast<int>(i / 5000) + 1) {
      kill(reader, SIGKILL);
      waitpid(reader, nullptr, 0);
      ++kills;
      reader = start_reader();
    }
  }
  int status = -1;
  waitpid(reader, &status, 0);
  CHECK(kills == 12);
  CHECK(WIFEXITED(status));
  CHECK(WEXITSTATUS(status) == 0);
  CHECK(report->next == item_count);
  CHECK(report->wrong == 0);
  CHECK(ring->size() == 0);
  CHECK(ring->impossible_fills() == 0);
  munmap(report, sizeof(Report));
}

TEST_CASE("an impossible consumer index counts as a full ring until a new consumer resets it", "[ring]") {
  auto ring = Ring<std::uint64_t>::in_shared_memory(8);
  REQUIRE(ring.ok());
  RawHeader header(ring->file_descriptor());
  for (const std::uint64_t corrupt : {std::uint64_t{1'000'000}, ~std::uint64_t{0}, std::uint64_t{1} << 63}) {
    header->consumed = corrupt;
    std::uint64_t accepted = 0;
    for (std::uint64_t i = 0; i < 100; ++i) accepted += ring->try_push(i) ? 1U : 0U;
    CHECK(accepted <= ring->capacity());
    CHECK(ring->begin_write(100).empty());
    CHECK(ring->size() <= ring->capacity());
    CHECK(ring->impossible_fills() > 0);

    auto consumer = Ring<std::uint64_t>::attach(ring->file_descriptor());
    REQUIRE(consumer.ok());
    CHECK(consumer->begin_read().empty());
    REQUIRE(ring->try_push(77));
    CHECK(consumer->try_pop() == 77);
  }
  CHECK(ring->dropped() > 0);
}

TEST_CASE("a consumer that overwrites the header never makes the producer write outside its memory",
          "[ring]") {
  auto ring = Ring<Item>::in_shared_memory(16);
  REQUIRE(ring.ok());
  RawHeader header(ring->file_descriptor());
  std::mt19937_64 random(3);
  std::uint64_t accepted = 0;
  for (std::uint64_t i = 0; i < 20'000; ++i) {
    header->written = random();
    header->capacity = random();
    header->high_water = random();
    // Half of the values are near the true one, where a check could be off by one.
    header->consumed = random() % 2 == 0 ? random() : accepted - 20 + random() % 40;
    const auto slots = ring->begin_write(1 + random() % 20);
    REQUIRE(slots.size() <= 16);
    for (Item& slot : slots) slot = make_item(i);  // a page fault if it were outside
    accepted += slots.size();
    ring->commit(slots.size());
  }
  CHECK(accepted > 0);
  CHECK(ring->impossible_fills() > 0);
}

TEST_CASE("attaching to anything but a matching ring fails with the reason", "[ring]") {
  using Catch::Matchers::Contains;
  CHECK_THAT(Ring<int>::attach(-1).error().message, Contains("file descriptor -1"));

  const int plain = memfd_create("plain", MFD_CLOEXEC);
  REQUIRE(ftruncate(plain, 4096) == 0);
  CHECK_THAT(Ring<int>::attach(plain).error().message, Contains("not a ring's shared memory"));
  close(plain);

  auto block = nilio::ipc::MemoryBlock::in_shared_memory(4096);
  REQUIRE(block.ok());
  CHECK_THAT(Ring<int>::attach(block->file_descriptor()).error().message, Contains("wrong magic"));

  auto ring = Ring<int>::in_shared_memory(64);
  REQUIRE(ring.ok());
  CHECK(Ring<int>::attach(ring->file_descriptor()).ok());
  CHECK_THAT(Ring<double>::attach(ring->file_descriptor()).error().message, Contains("slots of 4 bytes"));
  RawHeader header(ring->file_descriptor());
  for (const std::uint64_t capacity :
       {std::uint64_t{0}, std::uint64_t{63}, std::uint64_t{1} << 20, ~std::uint64_t{0}}) {
    header->capacity = capacity;
    CHECK_THAT(Ring<int>::attach(ring->file_descriptor()).error().message, Contains("does not fit"));
  }
  header->capacity = 64;
  header->version = 2;
  CHECK_THAT(Ring<int>::attach(ring->file_descriptor()).error().message, Contains("version 2"));
}

TEST_CASE("a shared ring cannot be resized by another process", "[ring]") {
  auto ring = Ring<int>::in_shared_memory(64);
  REQUIRE(ring.ok());
  CHECK(ftruncate(ring->file_descriptor(), 0) == -1);
}

TEST_CASE("a signal before the wait is not lost", "[ring]") {
  auto event = nilio::ipc::WakeEvent::create();
  REQUIRE(event.ok());
  CHECK_FALSE(event->wait({0}));
  event->notify();
  event->notify();
  CHECK(event->wait({0}));
  CHECK_FALSE(event->wait(nilio::core::Duration::from_milliseconds(1.0)));
  CHECK((fcntl(event->file_descriptor(), F_GETFD) & FD_CLOEXEC) != 0);
}

TEST_CASE("a wake event wakes a sleeping thread", "[ring]") {
  auto event = nilio::ipc::WakeEvent::create();
  REQUIRE(event.ok());
  bool woken = false;
  std::thread sleeper([&] { woken = event->wait(nilio::core::Duration::from_seconds(20.0)); });
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  event->notify();
  sleeper.join();
  CHECK(woken);
}

TEST_CASE("a wake event adopts only an eventfd", "[ring]") {
  using Catch::Matchers::Contains;
  auto event = nilio::ipc::WakeEvent::create();
  REQUIRE(event.ok());
  auto adopted = nilio::ipc::WakeEvent::adopt(dup(event->file_descriptor()));
  REQUIRE(adopted.ok());
  event->notify();
  CHECK(adopted->wait({0}));
  CHECK_THAT(nilio::ipc::WakeEvent::adopt(987).error().message, Contains("987 is not open"));
  const int file = open("/dev/null", O_RDONLY | O_CLOEXEC);
  CHECK_THAT(nilio::ipc::WakeEvent::adopt(file).error().message, Contains("not an eventfd"));
  close(file);
}
