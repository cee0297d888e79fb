#include "nilio/drivers/bag/mcap_writer.hpp"

#include "drivers/bag/mcap.hpp"
#include "drivers/bag/wire_writer.hpp"

#include <algorithm>
#include <array>
#include <utility>
#include <zlib.h>
#include <zstd.h>

namespace nilio::drivers {

namespace {

using bag::WireWriter;
using namespace bag::mcap;
using Bytes = std::vector<std::uint8_t>;

// Packets hardly compress and poses do: the fastest level gives most of it.
constexpr int kLevel = 1;
// Integers, as every version of rosbag2 reads them: keep last 10, reliable.
constexpr const char* kQos =
    "- history: 1\n  depth: 10\n  reliability: 1\n  durability: %d\n  deadline:\n    sec: 9223372036\n    "
    "nsec: "
    "854775807\n  lifespan:\n    sec: 9223372036\n    nsec: 854775807\n  liveliness: 1\n  "
    "liveliness_lease_duration:\n    sec: 9223372036\n    nsec: 854775807\n  "
    "avoid_ros_namespace_conventions: false\n";

void append_record(Bytes& out, Op op, const Bytes& content) {
  WireWriter(out).number(static_cast<std::uint8_t>(op)).number(std::uint64_t{content.size()}).bytes(content);
}

std::uint32_t checksum(std::span<const std::uint8_t> bytes) {
  return static_cast<std::uint32_t>(crc32_z(0, bytes.data(), bytes.size()));
}

/// Of all channels. The number of a schema is that of its channel plus 1: types repeat rarely.
void append_schemas(Bytes& out, const std::vector<McapWriter::Channel>& channels) {
  for (std::size_t i = 0; i < channels.size(); ++i) {
    Bytes content;
    WireWriter(content)
        .number(static_cast<std::uint16_t>(i + 1))
        .text(channels[i].type)
        .text("ros2msg")
        .text(channels[i].definition);
    append_record(out, kSchema, content);
  }
}

void append_channels(Bytes& out, const std::vector<McapWriter::Channel>& channels) {
  for (std::size_t i = 0; i < channels.size(); ++i) {
    std::array<char, 600> qos{};
    std::snprintf(qos.data(), qos.size(), kQos, channels[i].is_latched ? 1 : 2);
    Bytes metadata;
    WireWriter(metadata).text("offered_qos_profiles").text(qos.data());
    Bytes content;
    WireWriter(content)
        .number(static_cast<std::uint16_t>(i))
        .number(static_cast<std::uint16_t>(i + 1))
        .text(channels[i].topic)
        .text("cdr")
        .number(static_cast<std::uint32_t>(metadata.size()))
        .bytes(metadata);
    append_record(out, kChannel, content);
  }
}

Bytes file_header(const std::vector<McapWriter::Channel>& channels) {
  Bytes out(kMagic.begin(), kMagic.end());
  Bytes content;
  WireWriter(content).text("ros2").text("nilio");
  append_record(out, kHeader, content);
  append_schemas(out, channels);
  append_channels(out, channels);
  return out;
}

}  // namespace

class McapWriter::Compressor {
 public:
  Compressor() : context_(ZSTD_createCCtx(), ZSTD_freeCCtx) {}
  /// Empty if the memory does not suffice.
  std::span<const std::uint8_t> compress(const Bytes& input) {
    output_.resize(ZSTD_compressBound(input.size()));
    const std::size_t size =
        ZSTD_compressCCtx(context_.get(), output_.data(), output_.size(), input.data(), input.size(), kLevel);
    return {output_.data(), ZSTD_isError(size) != 0U ? 0 : size};
  }

 private:
  std::unique_ptr<ZSTD_CCtx, std::size_t (*)(ZSTD_CCtx*)> context_;
  Bytes output_;
};

McapWriter::McapWriter(std::filesystem::path path, std::vector<Channel> channels)
    : channels_(std::move(channels)),
      file_(std::move(path), file_header(channels_)),
      compressor_(std::make_unique<Compressor>()),
      entries_(channels_.size()),
      sequences_(channels_.size()),
      written_(channels_.size()) {}

McapWriter::~McapWriter() = default;

void McapWriter::add(std::size_t channel, core::Time stamp, std::span<const std::uint8_t> message) {
  first_ns_ = chunk_.empty() ? stamp.ns : std::min(first_ns_, stamp.ns);
  last_ns_ = chunk_.empty() ? stamp.ns : std::max(last_ns_, stamp.ns);
  entries_[channel].push_back({stamp.ns, chunk_.size()});
  WireWriter(chunk_)
      .number(static_cast<std::uint8_t>(kMessage))
      .number(std::uint64_t{kMessageHead + message.size()})
      .number(static_cast<std::uint16_t>(channel))
      .number(sequences_[channel]++)
      .number(stamp.ns)
      .number(stamp.ns)
      .bytes(message);
  if (chunk_.size() >= kChunkBytes) close_chunk();
}

void McapWriter::close_old_chunk(std::int64_t now_ns) {
  if (chunk_.empty()) return;
  if (!opened_ns_) opened_ns_ = now_ns;
  if (now_ns - *opened_ns_ >= kChunkNs) close_chunk();
}

void McapWriter::close_chunk() {
  const std::span<const std::uint8_t> packed = compressor_->compress(chunk_);
  Bytes content;
  WireWriter(content)
      .number(first_ns_)
      .number(last_ns_)
      .number(std::uint64_t{chunk_.size()})
      .number(checksum(chunk_))
      .text("zstd")
      .number(std::uint64_t{packed.size()})
      .bytes(packed);
  Bytes record;
  append_record(record, kChunk, content);
  ChunkIndex index{.first_ns = first_ns_,
                   .last_ns = last_ns_,
                   .length = record.size(),
                   .packed_bytes = packed.size(),
                   .bytes = chunk_.size(),
                   .index_offsets = std::vector<std::uint32_t>(channels_.size())};
  std::uint64_t messages = 0;
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    if (entries_[i].empty()) continue;
    messages += entries_[i].size();
    index.index_offsets[i] = static_cast<std::uint32_t>(record.size());
    Bytes entries;
    WireWriter writer(entries);
    writer.number(static_cast<std::uint16_t>(i)).number(static_cast<std::uint32_t>(16 * entries_[i].size()));
    for (const Entry& entry : entries_[i]) writer.number(entry.stamp_ns).number(entry.offset);
    append_record(record, kMessageIndex, entries);
  }
  index.index_length = record.size() - index.length;
  // The header precedes the first record of the file.
  const std::uint64_t header = file_.bytes_with_pending() == 0 ? file_header(channels_).size() : 0;
  index.offset = file_.bytes_with_pending() + header;
  if (!packed.empty() && file_.append(record)) {
    for (std::size_t i = 0; i < channels_.size(); ++i) written_[i] += entries_[i].size();
    chunks_.push_back(std::move(index));
  } else {
    lost_ += messages;
  }
  for (std::vector<Entry>& entries : entries_) entries.clear();
  chunk_.clear();
  opened_ns_.reset();
}

void McapWriter::finish() {
  if (!chunk_.empty()) close_chunk();
  if (chunks_.empty()) return;
  Bytes out;
  Bytes content;
  WireWriter(content).number(std::uint32_t{0});
  append_record(out, kDataEnd, content);
  const std::uint64_t base = file_.bytes_with_pending();
  const std::size_t summary = out.size();
  struct Group {
    Op op;
    std::size_t begin;
    std::size_t end;
  };
  std::vector<Group> groups;
  const auto add_group = [&](Op op, const auto& append) {
    const std::size_t begin = out.size();
    append();
    groups.push_back({op, begin, out.size()});
  };
  add_group(kSchema, [&] { append_schemas(out, channels_); });
  add_group(kChannel, [&] { append_channels(out, channels_); });
  add_group(kStatistics, [&] {
    std::uint64_t messages = 0;
    Bytes counts;
    for (std::size_t i = 0; i < written_.size(); ++i) {
      messages += written_[i];
      if (written_[i] > 0) WireWriter(counts).number(static_cast<std::uint16_t>(i)).number(written_[i]);
    }
    const auto first = std::ranges::min_element(chunks_, {}, &ChunkIndex::first_ns)->first_ns;
    const auto last = std::ranges::max_element(chunks_, {}, &ChunkIndex::last_ns)->last_ns;
    Bytes statistics;
    WireWriter(statistics)
        .number(messages)
        .number(static_cast<std::uint16_t>(channels_.size()))
        .number(static_cast<std::uint32_t>(channels_.size()))
        .number(std::uint32_t{0})
        .number(std::uint32_t{0})
        .number(static_cast<std::uint32_t>(chunks_.size()))
        .number(first)
        .number(last)
        .number(static_cast<std::uint32_t>(counts.size()))
        .bytes(counts);
    append_record(out, kStatistics, statistics);
  });
  add_group(kChunkIndex, [&] {
    for (const ChunkIndex& chunk : chunks_) {
      Bytes offsets;
      for (std::size_t i = 0; i < chunk.index_offsets.size(); ++i) {
        if (chunk.index_offsets[i] > 0)
          WireWriter(offsets)
              .number(static_cast<std::uint16_t>(i))
              .number(chunk.offset + chunk.index_offsets[i]);
      }
      Bytes index;
      WireWriter(index)
          .number(chunk.first_ns)
          .number(chunk.last_ns)
          .number(chunk.offset)
          .number(chunk.length)
          .number(static_cast<std::uint32_t>(offsets.size()))
          .bytes(offsets)
          .number(chunk.index_length)
          .text("zstd")
          .number(chunk.packed_bytes)
          .number(chunk.bytes);
      append_record(out, kChunkIndex, index);
    }
  });
  const std::size_t offsets = out.size();
  for (const Group& group : groups) {
    Bytes offset;
    WireWriter(offset)
        .number(static_cast<std::uint8_t>(group.op))
        .number(base + group.begin)
        .number(std::uint64_t{group.end - group.begin});
    append_record(out, kSummaryOffset, offset);
  }
  // The checksum covers the summary and the footer up to itself.
  WireWriter(out)
      .number(static_cast<std::uint8_t>(kFooter))
      .number(std::uint64_t{kFooterContent})
      .number(base + summary)
      .number(base + offsets);
  const std::uint32_t crc = checksum(std::span(out).subspan(summary));
  WireWriter(out).number(crc).bytes(kMagic);
  // A summary that the disk does not take leaves an unfinished file, which is readable.
  if (!file_.append(out)) ++lost_;
}

}  // namespace nilio::drivers
