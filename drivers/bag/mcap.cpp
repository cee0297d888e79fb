#include "drivers/bag/mcap.hpp"

#include "drivers/bag/decompress.hpp"
#include "drivers/bag/readers.hpp"
#include "drivers/bag/topic_table.hpp"
#include "drivers/bag/wire.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <utility>
#include <zlib.h>

namespace nilio::drivers::bag {

namespace {

using core::Error;
using core::Result;

using namespace mcap;

/// The last record and the magic at the end of a closed file.
constexpr std::size_t kFooterBytes = kRecordHead + kFooterContent + kMagic.size();
constexpr std::uint64_t kMaxRecord = std::uint64_t{16} << 20U;
constexpr std::uint64_t kMaxSummary = std::uint64_t{256} << 20U;

struct Record {
  std::uint8_t op = 0;
  std::span<const std::uint8_t> content;
};

/// Next record of a chunk or summary; empty at the end or at damage.
std::optional<Record> take_record(WireReader& wire) {
  if (wire.remaining() < kRecordHead) return std::nullopt;
  Record record;
  record.op = wire.number<std::uint8_t>();
  const auto length = wire.number<std::uint64_t>();
  record.content = wire.bytes(length);
  return wire.ok() && record.op != 0 ? std::optional(record) : std::nullopt;
}

BagEncoding encoding_of(std::string_view name) {
  if (name == "cdr") return BagEncoding::kCdr;
  return name == "ros1" ? BagEncoding::kRos1 : BagEncoding::kOther;
}

class Mcap : public BagReader {
 public:
  Mcap(std::unique_ptr<ByteSource> bytes, Filter filter)
      : bytes_(std::move(bytes)), table_(std::move(filter)), position_(kMagic.size()) {
    read_summary();
  }

  std::optional<BagMessage> next() override {
    for (;;) {
      if (const auto message = queue_.take()) return message;
      queue_.clear();
      if (!read_record()) return queue_.take();
    }
  }
  [[nodiscard]] const std::vector<BagTopic>& topics() const override { return table_.topics(); }
  [[nodiscard]] const std::vector<std::string>& notes() const override { return table_.notes(); }

 private:
  void read_summary();
  bool read_record();
  void read_chunk(std::uint64_t offset);
  void read_chunk_records(std::span<const std::uint8_t> records, bool is_whole);
  void take(const Record& record);
  void add_schema(WireReader wire);
  void add_channel(WireReader wire);
  void add_message(std::span<const std::uint8_t> content);
  bool skip_to_next_chunk(const std::string& reason);
  void note(const std::string& text) { table_.note(bytes_->name() + ": " + text); }

  std::unique_ptr<ByteSource> bytes_;
  TopicTable table_;
  ChunkQueue queue_;
  std::uint64_t position_;
  /// Of the chunk index, for continuing behind damage.
  std::vector<std::uint64_t> chunk_offsets_;
  std::map<std::uint16_t, std::string> schemas_;
  std::map<std::uint16_t, std::optional<std::size_t>> channels_;
  std::vector<std::uint8_t> raw_;
  std::vector<std::uint8_t> unpacked_;
  bool unknown_channel_ = false;
};

/// Channels and chunk offsets of a closed file; a missing or damaged summary is no loss.
void Mcap::read_summary() {
  const std::uint64_t size = bytes_->size();
  const bool has_room = size > kMagic.size() + kFooterBytes;
  const std::uint64_t footer = has_room ? size - kFooterBytes : 0;
  const bool is_closed = has_room && bytes_->read_all(footer, kFooterBytes, raw_) &&
                         raw_.front() == kFooter &&
                         std::equal(kMagic.begin(), kMagic.end(), raw_.end() - kMagic.size());
  if (!is_closed) {
    note("was not closed (a crash, or a recording in progress); read as far as it goes");
    return;
  }
  WireReader wire{std::span(raw_).subspan(kRecordHead)};
  const auto start = wire.number<std::uint64_t>();
  wire.number<std::uint64_t>();
  const auto expected_crc = wire.number<std::uint32_t>();
  if (start == 0 || start >= footer || footer - start > kMaxSummary) return;
  if (!bytes_->read_all(start, footer - start + kRecordHead + kFooterContent - sizeof expected_crc, raw_))
    return;
  if (expected_crc != 0 && crc32_z(0, raw_.data(), raw_.size()) != expected_crc) {
    note("its summary is damaged and not used");
    return;
  }
  WireReader records{std::span(raw_).first(static_cast<std::size_t>(footer - start))};
  while (const auto record = take_record(records)) {
    if (record->op != kChunkIndex) {
      take(*record);
      continue;
    }
    WireReader index(record->content);
    index.bytes(16);
    const auto offset = index.number<std::uint64_t>();
    if (index.ok()) chunk_offsets_.push_back(offset);
  }
  std::sort(chunk_offsets_.begin(), chunk_offsets_.end());
}

bool Mcap::read_record() {
  if (position_ >= bytes_->size()) return false;
  std::array<std::uint8_t, kRecordHead> head{};
  if (bytes_->read(position_, head) < head.size()) {
    note("ends within a record");
    return false;
  }
  WireReader wire(head);
  const auto op = wire.number<std::uint8_t>();
  const auto length = wire.number<std::uint64_t>();
  const std::uint64_t content = position_ + kRecordHead;
  if (op == kDataEnd || op == kFooter) return false;
  if (op == 0) return skip_to_next_chunk("zeros");
  const std::uint64_t left = bytes_->size() - content;
  if (op == kChunk) {
    // A cut chunk is read up to the cut.
    read_chunk(content);
    position_ = length > left ? bytes_->size() : content + length;
    return true;
  }
  if (length > left) {
    return skip_to_next_chunk("a record of " + std::to_string(length) + " bytes");
  }
  position_ = content + length;
  const bool is_used = op == kSchema || op == kChannel || op == kMessage;
  if (!is_used) return true;
  if (length > (op == kMessage ? kMaxBagChunk : kMaxRecord)) {
    note("a record of " + std::to_string(length) + " bytes is skipped");
    return true;
  }
  if (bytes_->read_all(content, length, raw_)) take({op, raw_});
  return true;
}

void Mcap::read_chunk(std::uint64_t offset) {
  // Two stamps, size, checksum, name of the compression, size of the records.
  constexpr std::size_t kLongestHead = 8 + 8 + 8 + 4 + 4 + 16 + 8;
  std::vector<std::uint8_t> head;
  bytes_->read_all(offset, kLongestHead, head);
  WireReader wire(head);
  wire.bytes(16);
  const auto size = wire.number<std::uint64_t>();
  const auto expected_crc = wire.number<std::uint32_t>();
  const std::string_view name = wire.text();
  const auto packed_size = wire.number<std::uint64_t>();
  const auto compression = parse_compression(name);
  const std::string where = "the chunk at byte " + std::to_string(offset - kRecordHead);
  if (!wire.ok() || !compression || *compression == Compression::kBz2) {
    note(where + " is damaged or of an unknown compression, and skipped");
    return;
  }
  if (size > kMaxBagChunk || packed_size > kMaxBagChunk) {
    note(where + " declares " + std::to_string(std::max(size, packed_size)) + " bytes and is skipped");
    return;
  }
  const bool is_there = bytes_->read_all(offset + wire.position(), packed_size, raw_);
  if (*compression == Compression::kNone) {
    raw_.swap(unpacked_);
  } else {
    decompress(*compression, raw_, size, unpacked_);
  }
  const bool is_whole = is_there && unpacked_.size() == size;
  if (!is_whole)
    note(where + " is cut or damaged; " + std::to_string(unpacked_.size()) + " of its " +
         std::to_string(size) + " bytes are read");
  if (is_whole && expected_crc != 0 && crc32_z(0, unpacked_.data(), unpacked_.size()) != expected_crc) {
    note(where + " has a wrong checksum and is skipped");
    return;
  }
  read_chunk_records(unpacked_, is_whole);
}

void Mcap::read_chunk_records(std::span<const std::uint8_t> records, bool is_whole) {
  WireReader wire(records);
  while (const auto record = take_record(wire)) take(*record);
  if (is_whole && (!wire.ok() || wire.remaining() > 0)) note("the rest of a chunk is damaged and skipped");
  queue_.sort();
}

void Mcap::take(const Record& record) {
  if (record.op == kSchema) add_schema(WireReader(record.content));
  if (record.op == kChannel) add_channel(WireReader(record.content));
  if (record.op == kMessage) add_message(record.content);
}

void Mcap::add_schema(WireReader wire) {
  const auto id = wire.number<std::uint16_t>();
  const std::string_view name = wire.text();
  if (wire.ok() && id != 0) schemas_.emplace(id, plain_type(name));
}

void Mcap::add_channel(WireReader wire) {
  const auto id = wire.number<std::uint16_t>();
  const auto schema = wire.number<std::uint16_t>();
  const std::string_view name = wire.text();
  const std::string_view encoding = wire.text();
  if (!wire.ok() || channels_.contains(id)) return;
  BagTopic topic;
  topic.name = std::string(name);
  topic.encoding = encoding_of(encoding);
  if (const auto found = schemas_.find(schema); found != schemas_.end()) topic.type = found->second;
  channels_[id] = table_.add(std::move(topic));
}

void Mcap::add_message(std::span<const std::uint8_t> content) {
  WireReader wire(content);
  const auto id = wire.number<std::uint16_t>();
  wire.number<std::uint32_t>();
  const auto log_time = wire.number<std::uint64_t>();
  if (content.size() < kMessageHead) return;
  const auto found = channels_.find(id);
  if (found == channels_.end()) {
    if (!std::exchange(unknown_channel_, true)) note("messages of an unknown channel are skipped");
    return;
  }
  constexpr std::uint64_t kLatest = std::numeric_limits<std::int64_t>::max();
  const core::Time stamp = limit_stamp(static_cast<std::int64_t>(std::min(log_time, kLatest)));
  if (found->second && table_.is_wanted(*found->second))
    queue_.add({*found->second, stamp, content.subspan(kMessageHead)});
}

/// Continues at the next chunk of the index; false, at the end, without one.
bool Mcap::skip_to_next_chunk(const std::string& reason) {
  const auto next = std::upper_bound(chunk_offsets_.begin(), chunk_offsets_.end(), position_);
  const bool has_next = next != chunk_offsets_.end() && *next < bytes_->size();
  const std::uint64_t target = has_next ? *next : bytes_->size();
  note(reason + " at byte " + std::to_string(position_) + "; " + std::to_string(target - position_) +
       " bytes are skipped");
  position_ = target;
  return has_next;
}

}  // namespace

Result<std::unique_ptr<BagReader>> open_mcap(std::unique_ptr<ByteSource> bytes, BagReader::Filter filter) {
  std::vector<std::uint8_t> magic;
  if (!bytes->read_all(0, kMagic.size(), magic) || !std::equal(kMagic.begin(), kMagic.end(), magic.begin()))
    return Error{bytes->name() + ": is no MCAP file of version 0"};
  return std::unique_ptr<BagReader>(std::make_unique<Mcap>(std::move(bytes), std::move(filter)));
}

}  // namespace nilio::drivers::bag
