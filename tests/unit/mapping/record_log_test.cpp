#include "mapping/record_log.hpp"

#include "tests/support/temporary_folder.hpp"

#include <filesystem>
#include <fstream>

#include <catch2/catch.hpp>

namespace {

using namespace nilio::mapping;
using nilio::tests::TemporaryFolder;

Bytes payload_of(std::uint8_t value) { return Bytes(10U + value, value); }

void write_records(const std::filesystem::path& path, int count) {
  auto log = RecordLog::open(path);
  REQUIRE(log.ok());
  for (int i = 0; i < count; ++i)
    REQUIRE(log->append(static_cast<std::uint16_t>(i), payload_of(static_cast<std::uint8_t>(i)), false).ok());
}

}  // namespace

TEST_CASE("records are read back, and a log that is cut anywhere keeps its whole records", "[record_log]") {
  const TemporaryFolder folder;
  const auto path = folder.path() / "a.log";
  write_records(path, 5);
  const auto content = read_log(path);
  REQUIRE(content.ok());
  REQUIRE(content->records.size() == 5);
  CHECK(content->valid_bytes == content->bytes.size());
  for (std::size_t i = 0; i < 5; ++i) {
    CHECK(content->records[i].type == i);
    const Bytes expected = payload_of(static_cast<std::uint8_t>(i));
    CHECK(std::equal(expected.begin(), expected.end(), content->records[i].payload.begin(),
                     content->records[i].payload.end()));
  }
  std::size_t last = 5;
  for (std::size_t bytes = content->bytes.size(); bytes-- > 0;) {
    std::filesystem::resize_file(path, bytes);
    const auto cut = read_log(path);
    REQUIRE(cut.ok());
    CHECK(cut->records.size() <= last);
    last = cut->records.size();
  }
  CHECK(last == 0);
}

TEST_CASE("a log continues behind its intact records", "[record_log]") {
  const TemporaryFolder folder;
  const auto path = folder.path() / "a.log";
  write_records(path, 3);
  std::filesystem::resize_file(path, std::filesystem::file_size(path) - 1);
  {
    const auto content = read_log(path);
    REQUIRE(content.ok());
    auto log = RecordLog::open(path, content->valid_bytes, content->records.size());
    REQUIRE(log.ok());
    REQUIRE(log->append(9, payload_of(9), true).ok());
  }
  const auto content = read_log(path);
  REQUIRE(content.ok());
  REQUIRE(content->records.size() == 3);
  CHECK(content->records[2].type == 9);
  CHECK(content->valid_bytes == content->bytes.size());
}

TEST_CASE("a flipped bit ends a log before the damaged record", "[record_log]") {
  const TemporaryFolder folder;
  const auto path = folder.path() / "a.log";
  write_records(path, 3);
  const auto size = std::filesystem::file_size(path);
  for (std::uintmax_t at = 0; at < size; ++at) {
    auto bytes = read_bytes(path);
    REQUIRE(bytes.ok());
    (*bytes)[at] ^= 1U;
    REQUIRE(replace_file(folder.path() / "bad.log", *bytes).ok());
    const auto content = read_log(folder.path() / "bad.log");
    REQUIRE(content.ok());
    CHECK(content->records.size() < 3);
  }
}

TEST_CASE("a file is locked against a second writer, and replaced without a trace of the replacement",
          "[record_log]") {
  const TemporaryFolder folder;
  auto first = RecordLog::open(folder.path() / "lock");
  auto second = RecordLog::open(folder.path() / "lock");
  REQUIRE((first.ok() && second.ok()));
  CHECK(first->lock());
  CHECK_FALSE(second->lock());
  const auto path = folder.path() / "file";
  REQUIRE(replace_file(path, payload_of(1)).ok());
  REQUIRE(replace_file(path, payload_of(2)).ok());
  CHECK(*read_bytes(path) == payload_of(2));
  CHECK(std::distance(std::filesystem::directory_iterator(folder.path()), {}) == 2);
  using Catch::Matchers::Contains;
  CHECK_THAT(replace_file("/proc/nowhere/file", {}).error().message, Contains("/proc/nowhere/file"));
  CHECK_FALSE(read_bytes(folder.path()).ok());
}
