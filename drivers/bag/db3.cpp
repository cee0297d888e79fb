#include "drivers/bag/decompress.hpp"
#include "drivers/bag/readers.hpp"
#include "drivers/bag/topic_table.hpp"

#include <array>
#include <filesystem>
#include <map>
#include <optional>
#include <sqlite3.h>
#include <utility>

namespace nilio::drivers::bag {

namespace {

using core::Error;
using core::Result;

struct CloseDatabase {
  void operator()(sqlite3* database) const { sqlite3_close_v2(database); }
};
struct FinalizeStatement {
  void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
};
using Database = std::unique_ptr<sqlite3, CloseDatabase>;
using Statement = std::unique_ptr<sqlite3_stmt, FinalizeStatement>;

Statement prepare(sqlite3* database, const std::string& sql) {
  sqlite3_stmt* statement = nullptr;
  sqlite3_prepare_v2(database, sql.c_str(), -1, &statement, nullptr);
  return Statement(statement);
}

std::string text_at(sqlite3_stmt* statement, int column) {
  const auto* const text = reinterpret_cast<const char*>(sqlite3_column_text(statement, column));
  return text == nullptr
             ? ""
             : std::string(text, static_cast<std::size_t>(sqlite3_column_bytes(statement, column)));
}

/// A file from anywhere: no schema of its own may run code, and no value may be larger than a message.
void protect(sqlite3* database) {
  sqlite3_limit(database, SQLITE_LIMIT_LENGTH, static_cast<int>(kMaxBagChunk));
  sqlite3_limit(database, SQLITE_LIMIT_ATTACHED, 0);
  sqlite3_db_config(database, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  sqlite3_exec(database, "PRAGMA trusted_schema=OFF; PRAGMA cell_size_check=ON; PRAGMA mmap_size=0;", nullptr,
               nullptr, nullptr);
}

/// Tables of a ROS 2 bag, two if it is one; empty if the file cannot be read.
std::optional<int> count_tables(sqlite3* database) {
  const Statement tables = prepare(database,
                                   "SELECT count(*) FROM sqlite_master WHERE type='table' AND name IN "
                                   "('topics','messages')");
  if (!tables || sqlite3_step(tables.get()) != SQLITE_ROW) return std::nullopt;
  return sqlite3_column_int(tables.get(), 0);
}

class Db3 : public BagReader {
 public:
  Db3(Database database, std::string name, Filter filter)
      : database_(std::move(database)), name_(std::move(name)), table_(std::move(filter)) {}

  Result<std::monostate> begin();
  std::optional<BagMessage> next() override;
  [[nodiscard]] const std::vector<BagTopic>& topics() const override { return table_.topics(); }
  [[nodiscard]] const std::vector<std::string>& notes() const override { return table_.notes(); }

 private:
  void note(const std::string& text) { table_.note(name_ + ": " + text); }

  Database database_;
  std::string name_;
  TopicTable table_;
  Statement messages_;
  std::map<std::int64_t, std::size_t> topic_of_;
  std::vector<std::uint8_t> unpacked_;
  std::uint64_t rows_ = 0;
  bool ended_ = false;
  bool bad_compression_ = false;
};

Result<std::monostate> Db3::begin() {
  const auto fail = [&](const std::string& reason) { return Error{name_ + ": " + reason}; };
  std::optional<int> tables = count_tables(database_.get());
  if (!tables && sqlite3_errcode(database_.get()) == SQLITE_CORRUPT) {
    // Mode in which SQLite opens a file that is shorter than its header says; nothing is written to it.
    sqlite3_db_config(database_.get(), SQLITE_DBCONFIG_DEFENSIVE, 0, nullptr);
    sqlite3_exec(database_.get(), "PRAGMA writable_schema=ON", nullptr, nullptr, nullptr);
    tables = count_tables(database_.get());
    if (tables) note("is cut or damaged; read as far as it goes");
  }
  if (!tables) return fail(std::string("cannot be read as SQLite (") + sqlite3_errmsg(database_.get()) + ")");
  if (*tables != 2) return fail("is an SQLite file without the tables of a ROS 2 bag (topics, messages)");
  const Statement topics = prepare(database_.get(), "SELECT id,name,type,serialization_format FROM topics");
  if (!topics)
    return fail(std::string("its table of topics cannot be read (") + sqlite3_errmsg(database_.get()) + ")");
  std::string wanted;
  while (sqlite3_step(topics.get()) == SQLITE_ROW) {
    BagTopic topic;
    topic.name = text_at(topics.get(), 1);
    topic.type = plain_type(text_at(topics.get(), 2));
    topic.encoding = text_at(topics.get(), 3) == "cdr" ? BagEncoding::kCdr : BagEncoding::kOther;
    const std::int64_t id = sqlite3_column_int64(topics.get(), 0);
    const auto index = table_.add(std::move(topic));
    if (!index || !table_.is_wanted(*index) || wanted.size() > 100'000) continue;
    topic_of_[id] = *index;
    wanted += (wanted.empty() ? "" : ",") + std::to_string(id);
  }
  // In the order of recording: that of stamps jumps through the file, by a factor of three slower.
  messages_ = prepare(database_.get(), "SELECT topic_id,timestamp,data FROM messages WHERE topic_id IN (" +
                                           wanted + ") ORDER BY rowid");
  if (!messages_)
    return fail(std::string("its messages cannot be read (") + sqlite3_errmsg(database_.get()) + ")");
  return std::monostate{};
}

std::optional<BagMessage> Db3::next() {
  while (!ended_) {
    const int state = sqlite3_step(messages_.get());
    if (state != SQLITE_ROW) {
      ended_ = true;
      if (state != SQLITE_DONE)
        note(std::string("is damaged (") + sqlite3_errmsg(database_.get()) + "); " + std::to_string(rows_) +
             " messages are read");
      return std::nullopt;
    }
    ++rows_;
    const auto found = topic_of_.find(sqlite3_column_int64(messages_.get(), 0));
    if (found == topic_of_.end()) continue;
    BagMessage message;
    message.topic = found->second;
    message.stamp = limit_stamp(sqlite3_column_int64(messages_.get(), 1));
    const auto* const blob = static_cast<const std::uint8_t*>(sqlite3_column_blob(messages_.get(), 2));
    message.data = {blob,
                    blob == nullptr ? 0 : static_cast<std::size_t>(sqlite3_column_bytes(messages_.get(), 2))};
    if (!is_zstd(message.data)) return message;
    // Compression mode "message"; CDR begins otherwise.
    const auto size = zstd_content_size(message.data);
    if (size && *size <= kMaxBagChunk && decompress(Compression::kZstd, message.data, *size, unpacked_)) {
      message.data = unpacked_;
      return message;
    }
    if (!std::exchange(bad_compression_, true)) note("messages whose compression is damaged are skipped");
  }
  return std::nullopt;
}

Result<std::unique_ptr<BagReader>> open_database(Database database, const std::string& name,
                                                 BagReader::Filter filter) {
  protect(database.get());
  auto reader = std::make_unique<Db3>(std::move(database), name, std::move(filter));
  if (auto begun = reader->begin(); !begun) return begun.error();
  return std::unique_ptr<BagReader>(std::move(reader));
}

/// Path as a URI of SQLite.
std::string uri_of(const std::string& path, const char* options) {
  constexpr std::string_view kHex = "0123456789ABCDEF";
  std::string uri = "file:";
  for (const char c : std::filesystem::absolute(path).string()) {
    const auto byte = static_cast<unsigned char>(c);
    const bool is_plain = (std::isalnum(byte) != 0) || c == '/' || c == '.' || c == '_' || c == '-';
    if (is_plain) {
      uri += c;
    } else {
      uri += {'%', kHex[byte >> 4U], kHex[byte & 15U]};
    }
  }
  return uri + options;
}

}  // namespace

Result<std::unique_ptr<BagReader>> open_db3(const std::string& path, BagReader::Filter filter) {
  // An immutable file is neither locked nor is anything written beside it; a write-ahead log holds its tail.
  std::error_code code;
  const bool has_log =
      std::filesystem::exists(path + "-wal", code) && std::filesystem::file_size(path + "-wal", code) > 0;
  sqlite3* raw = nullptr;
  const int state = sqlite3_open_v2(uri_of(path, has_log ? "?mode=ro" : "?immutable=1").c_str(), &raw,
                                    SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, nullptr);
  Database database(raw);
  if (state != SQLITE_OK)
    return Error{path + ": cannot be opened (" + sqlite3_errstr(state) + ") - check path and permissions"};
  return open_database(std::move(database), path, std::move(filter));
}

Result<std::unique_ptr<BagReader>> open_db3(std::span<const std::uint8_t> bytes, BagReader::Filter filter) {
  sqlite3* raw = nullptr;
  sqlite3_open_v2(":memory:", &raw, SQLITE_OPEN_READWRITE, nullptr);
  Database database(raw);
  // SQLite does not write to a read-only image.
  auto* const image = const_cast<std::uint8_t*>(bytes.data());
  const auto size = static_cast<sqlite3_int64>(bytes.size());
  if (database == nullptr || sqlite3_deserialize(database.get(), "main", image, size, size,
                                                 SQLITE_DESERIALIZE_READONLY) != SQLITE_OK)
    return Error{"memory: cannot be read as SQLite"};
  return open_database(std::move(database), "memory", std::move(filter));
}

}  // namespace nilio::drivers::bag
