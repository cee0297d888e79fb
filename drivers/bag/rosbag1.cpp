#include "drivers/bag/decompress.hpp"
#include "drivers/bag/readers.hpp"
#include "drivers/bag/topic_table.hpp"
#include "drivers/bag/wire.hpp"

#include <algorithm>
#include <string_view>
#include <unordered_map>
#include <utility>

namespace nilio::drivers::bag {

namespace {

using core::Error;
using core::Result;
using namespace std::string_view_literals;

constexpr std::string_view kMagic = "#ROSBAG V2.0\n";
constexpr std::uint32_t kMaxHeader = 64 * 1024;
constexpr std::uint32_t kMaxConnection = std::uint32_t{4} << 20U;
constexpr std::size_t kSearchBlock = std::size_t{1} << 20U;

enum Op : std::uint8_t {
  kMessage = 2,
  kFileHeader = 3,
  kIndexData = 4,
  kChunk = 5,
  kChunkInfo = 6,
  kConnection = 7,
};

/// Fields of a record header; the views point into the record.
struct Header {
  std::uint8_t op = 0;
  std::uint32_t connection = 0;
  core::Time time;
  std::uint32_t size = 0;
  std::uint32_t count = 0;
  std::uint64_t index_position = 0;
  bool has_size = false;
  std::string_view compression;
  std::string_view topic;
  std::string_view encryptor;
};

std::string_view text_of(std::span<const std::uint8_t> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// Calls `use(name, value)` for each field; false if they do not fill the bytes.
template <class Use>
bool read_fields(std::span<const std::uint8_t> bytes, Use use) {
  WireReader wire(bytes);
  while (wire.ok() && wire.remaining() > 0) {
    const std::span<const std::uint8_t> field = wire.blob();
    const std::string_view text = text_of(field);
    const std::size_t equals = text.find('=');
    if (!wire.ok() || equals == std::string_view::npos) return false;
    use(text.substr(0, equals), field.subspan(equals + 1));
  }
  return wire.ok();
}

std::optional<Header> parse_header(std::span<const std::uint8_t> bytes) {
  Header header;
  const bool whole = read_fields(bytes, [&](std::string_view name, std::span<const std::uint8_t> value) {
    WireReader number(value);
    if (name == "op") header.op = number.number<std::uint8_t>();
    if (name == "conn") header.connection = number.number<std::uint32_t>();
    if (name == "time") header.time = number.time();
    if (name == "count") header.count = number.number<std::uint32_t>();
    if (name == "index_pos") header.index_position = number.number<std::uint64_t>();
    if (name == "compression") header.compression = text_of(value);
    if (name == "topic") header.topic = text_of(value);
    if (name == "encryptor") header.encryptor = text_of(value);
    if (name == "size" && value.size() == 4) {
      header.size = number.number<std::uint32_t>();
      header.has_size = true;
    }
  });
  return whole && header.op != 0 ? std::optional(header) : std::nullopt;
}

class Rosbag1 : public BagReader {
 public:
  Rosbag1(std::unique_ptr<ByteSource> bytes, Filter filter)
      : bytes_(std::move(bytes)), table_(std::move(filter)), position_(kMagic.size()) {}

  std::optional<BagMessage> next() override {
    for (;;) {
      if (const auto message = queue_.take()) return message;
      queue_.clear();
      if (!read_record()) return queue_.take();
    }
  }
  [[nodiscard]] const std::vector<BagTopic>& topics() const override { return table_.topics(); }
  [[nodiscard]] const std::vector<std::string>& notes() const override { return table_.notes(); }
  /// The first record; an error if the bag cannot be read at all.
  Result<std::monostate> begin();

 private:
  struct Connection {
    std::size_t topic = 0;
    bool is_known = false;
  };

  bool read_record();
  bool read_chunk(const Header& header, std::uint64_t data_offset, std::uint32_t data_size);
  void read_chunk_records(std::span<const std::uint8_t> records, bool is_whole);
  void read_top_level(const Header& header, std::uint64_t data_offset, std::uint32_t data_size);
  void add_connection(const Header& header, std::span<const std::uint8_t> data);
  void add_message(const Header& header, std::span<const std::uint8_t> data);
  bool resynchronise(const std::string& reason);
  void note(const std::string& text) { table_.note(bytes_->name() + ": " + text); }

  std::unique_ptr<ByteSource> bytes_;
  TopicTable table_;
  ChunkQueue queue_;
  std::uint64_t position_;
  std::vector<std::uint8_t> header_;
  std::vector<std::uint8_t> raw_;
  std::vector<std::uint8_t> unpacked_;
  std::unordered_map<std::uint32_t, std::optional<std::size_t>> connections_;
  std::uint64_t unknown_connection_ = 0;
  bool ended_ = false;
};

Result<std::monostate> Rosbag1::begin() {
  std::array<std::uint8_t, 4> length{};
  if (bytes_->read(position_, length) < length.size())
    return Error{bytes_->name() + ": ends after its first line - nothing was recorded"};
  const auto header_size = WireReader(length).number<std::uint32_t>();
  if (header_size > kMaxHeader || !bytes_->read_all(position_ + 4, header_size, header_))
    return std::monostate{};
  const auto header = parse_header(header_);
  if (!header || header->op != kFileHeader) return std::monostate{};
  if (!header->encryptor.empty() && header->encryptor != "rosbag/NoEncryptor")
    return Error{bytes_->name() + ": is encrypted (" + std::string(header->encryptor) +
                 ") - decrypt it with 'rosbag decompress' where its key is"};
  if (header->index_position == 0)
    note("was not closed (no index, a crash or a recording in progress); read as far as it goes");
  return std::monostate{};
}

/// Reads one record of the file; false at the end.
bool Rosbag1::read_record() {
  if (ended_ || position_ >= bytes_->size()) return false;
  std::array<std::uint8_t, 4> length{};
  if (bytes_->read(position_, length) < length.size()) {
    note("ends within a record");
    return false;
  }
  const auto header_size = WireReader(length).number<std::uint32_t>();
  if (header_size == 0) {
    note("zeros from byte " + std::to_string(position_) + " on are taken as the end");
    return false;
  }
  if (header_size > kMaxHeader)
    return resynchronise("a record header of " + std::to_string(header_size) + " bytes");
  if (!bytes_->read_all(position_ + 4, header_size, header_)) {
    note("ends within a record");
    return false;
  }
  const auto header = parse_header(header_);
  const std::uint64_t size_offset = position_ + 4 + header_size;
  if (!header) return resynchronise("a damaged record header");
  if (bytes_->read(size_offset, length) < length.size()) {
    note("ends within a record");
    return false;
  }
  auto data_size = WireReader(length).number<std::uint32_t>();
  // Bags before version 1.1.15 give a wrong size for the index.
  if (header->op == kIndexData && header->count <= UINT32_MAX / 12) data_size = header->count * 12;
  const std::uint64_t data_offset = size_offset + 4;
  if (header->op == kChunk) return read_chunk(*header, data_offset, data_size);
  position_ = data_offset + data_size;
  read_top_level(*header, data_offset, data_size);
  return true;
}

/// Records outside of chunks: the connections of the index, and all records of a chunk that was never closed.
void Rosbag1::read_top_level(const Header& header, std::uint64_t data_offset, std::uint32_t data_size) {
  if (header.op != kMessage && header.op != kConnection) return;
  if (data_size > (header.op == kConnection ? kMaxConnection : kMaxBagChunk)) {
    note("a message of " + std::to_string(data_size) + " bytes is skipped");
    return;
  }
  if (!bytes_->read_all(data_offset, data_size, raw_)) {
    note("ends within a message, which is skipped");
    return;
  }
  if (header.op == kConnection) {
    add_connection(header, raw_);
  } else {
    add_message(header, raw_);
  }
}

bool Rosbag1::read_chunk(const Header& header, std::uint64_t data_offset, std::uint32_t data_size) {
  const auto compression = parse_compression(header.compression);
  if (!compression || *compression == Compression::kZstd || !header.has_size)
    return resynchronise("a chunk of unknown compression '" + std::string(header.compression.substr(0, 20)) +
                         "'");
  if (header.size > kMaxBagChunk || data_size > kMaxBagChunk)
    return resynchronise("a chunk of " + std::to_string(std::max(header.size, data_size)) + " bytes");
  if (header.size == 0 && data_size == 0) {
    // The recorder was killed while this chunk was open.
    position_ = data_offset;
    if (*compression == Compression::kNone) return true;
    note("the last chunk was not closed; its messages, less than 1 MB, are lost");
    ended_ = true;
    return true;
  }
  const bool is_there = bytes_->read_all(data_offset, data_size, raw_);
  position_ = data_offset + data_size;
  if (*compression == Compression::kNone) {
    read_chunk_records(raw_, is_there && data_size == header.size);
    return true;
  }
  const bool whole = decompress(*compression, raw_, header.size, unpacked_) && is_there;
  if (!whole)
    note("the chunk at byte " + std::to_string(data_offset) + " is damaged; " +
         std::to_string(unpacked_.size()) + " of its " + std::to_string(header.size) + " bytes are read");
  read_chunk_records(unpacked_, whole);
  return true;
}

void Rosbag1::read_chunk_records(std::span<const std::uint8_t> records, bool is_whole) {
  WireReader wire(records);
  while (wire.remaining() > 0) {
    const std::span<const std::uint8_t> header_bytes = wire.blob();
    const std::span<const std::uint8_t> data = wire.blob();
    const auto header =
        wire.ok() && header_bytes.size() <= kMaxHeader ? parse_header(header_bytes) : std::nullopt;
    if (!header) {
      if (is_whole || wire.ok()) note("the rest of a chunk is damaged and skipped");
      if (!is_whole && !wire.ok()) note("ends within a chunk");
      break;
    }
    if (header->op == kConnection && data.size() <= kMaxConnection) add_connection(*header, data);
    if (header->op == kMessage) add_message(*header, data);
  }
  queue_.sort();
}

void Rosbag1::add_connection(const Header& header, std::span<const std::uint8_t> data) {
  if (connections_.size() >= 65'536 || connections_.contains(header.connection)) return;
  BagTopic topic;
  topic.name = std::string(header.topic);
  topic.encoding = BagEncoding::kRos1;
  const bool whole = read_fields(data, [&](std::string_view name, std::span<const std::uint8_t> value) {
    if (name == "type") topic.type = text_of(value);
    if (name == "md5sum") topic.md5 = text_of(value);
  });
  if (!whole || topic.type.empty()) note("the connection of topic " + topic.name + " is damaged");
  connections_[header.connection] = table_.add(std::move(topic));
}

void Rosbag1::add_message(const Header& header, std::span<const std::uint8_t> data) {
  const auto found = connections_.find(header.connection);
  if (found == connections_.end()) {
    if (unknown_connection_++ == 0) note("messages of an unknown connection are skipped");
    return;
  }
  if (found->second && table_.is_wanted(*found->second)) queue_.add({*found->second, header.time, data});
}

/// Continues at the next chunk behind damage; false if there is none.
bool Rosbag1::resynchronise(const std::string& reason) {
  // A chunk's header holds this field; its first field may be any.
  constexpr std::string_view kField = "\x04\x00\x00\x00op=\x05"sv;
  const std::uint64_t damaged = position_;
  for (std::uint64_t at = position_ + 1; at < bytes_->size(); at += kSearchBlock - kMaxHeader) {
    bytes_->read_all(at, kSearchBlock, raw_);
    const std::string_view block = text_of(raw_);
    for (std::size_t found = block.find(kField); found != std::string_view::npos;
         found = block.find(kField, found + 1)) {
      // The length of the header is within the 64 bytes before the field.
      for (std::size_t back = 4; back <= std::min<std::size_t>(found, 64); ++back) {
        const std::span<const std::uint8_t> from = std::span(raw_).subspan(found - back);
        const auto header_size = WireReader(from).number<std::uint32_t>();
        if (header_size < kField.size() || header_size > 128 || from.size() < 4 + header_size) continue;
        const auto header = parse_header(from.subspan(4, header_size));
        if (!header || header->op != kChunk || !header->has_size || !parse_compression(header->compression))
          continue;
        position_ = at + found - back;
        note(reason + " at byte " + std::to_string(damaged) + "; " + std::to_string(position_ - damaged) +
             " bytes are skipped");
        return true;
      }
    }
    if (raw_.size() < kSearchBlock) break;
  }
  note(reason + " at byte " + std::to_string(damaged) + "; the remaining " +
       std::to_string(bytes_->size() - damaged) + " bytes are skipped");
  ended_ = true;
  return false;
}

}  // namespace

Result<std::unique_ptr<BagReader>> open_rosbag1(std::unique_ptr<ByteSource> bytes, BagReader::Filter filter) {
  std::vector<std::uint8_t> magic;
  bytes->read_all(0, kMagic.size(), magic);
  if (text_of(magic) != kMagic) {
    const std::string version(text_of(magic).substr(0, kMagic.size() - 1));
    return Error{bytes->name() + ": is of an old format ('" + version +
                 "') - convert it with 'rosbag fix' of ROS 1 to format 2.0"};
  }
  auto reader = std::make_unique<Rosbag1>(std::move(bytes), std::move(filter));
  if (auto begun = reader->begin(); !begun) return begun.error();
  return std::unique_ptr<BagReader>(std::move(reader));
}

}  // namespace nilio::drivers::bag
