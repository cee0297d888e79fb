#include "drivers/bag/decompress.hpp"

#include <algorithm>
#include <array>
#include <bzlib.h>
#include <limits>
#include <lz4frame.h>
#include <memory>
#include <zstd.h>

namespace nilio::drivers::bag {

namespace {

// First size of the output: a small input that declares a large size allocates little.
constexpr std::size_t kSmallestBlock = std::size_t{64} << 10U;
constexpr std::size_t kUsualRatio = 16;

/// Bytes that one step read and wrote; `more` is false at the end of the stream and at damage.
struct Step {
  std::size_t read = 0;
  std::size_t written = 0;
  bool more = true;
};

/// Runs `step(input, output)` until the stream ends, and returns whether it gave exactly `size` bytes.
template <class StepFunction>
bool unpack(std::span<const std::uint8_t> input, std::uint64_t size, std::vector<std::uint8_t>& output,
            StepFunction step) {
  output.clear();
  std::uint64_t block = std::max(kSmallestBlock, kUsualRatio * input.size());
  std::size_t written = 0;
  while (written < size && !input.empty()) {
    if (output.size() == written) {
      output.resize(static_cast<std::size_t>(std::min(size, block)));
      block *= 2;
    }
    const Step done = step(input, std::span(output).subspan(written));
    input = input.subspan(done.read);
    written += done.written;
    if (!done.more || (done.read == 0 && done.written == 0)) break;
  }
  output.resize(written);
  return written == size;
}

bool unpack_bz2(std::span<const std::uint8_t> input, std::uint64_t size, std::vector<std::uint8_t>& output) {
  bz_stream stream{};
  if (BZ2_bzDecompressInit(&stream, 0, 0) != BZ_OK) return false;
  const bool whole = unpack(input, size, output, [&](auto in, auto out) {
    // bzlib does not write to its input.
    stream.next_in = const_cast<char*>(reinterpret_cast<const char*>(in.data()));
    stream.avail_in = static_cast<unsigned>(std::min<std::size_t>(in.size(), UINT32_MAX));
    stream.next_out = reinterpret_cast<char*>(out.data());
    stream.avail_out = static_cast<unsigned>(std::min<std::size_t>(out.size(), UINT32_MAX));
    const unsigned in_before = stream.avail_in;
    const unsigned out_before = stream.avail_out;
    const int state = BZ2_bzDecompress(&stream);
    return Step{in_before - stream.avail_in, out_before - stream.avail_out, state == BZ_OK};
  });
  BZ2_bzDecompressEnd(&stream);
  return whole;
}

bool unpack_lz4(std::span<const std::uint8_t> input, std::uint64_t size, std::vector<std::uint8_t>& output) {
  LZ4F_dctx* raw = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&raw, LZ4F_VERSION)) != 0U) return false;
  const std::unique_ptr<LZ4F_dctx, LZ4F_errorCode_t (*)(LZ4F_dctx*)> context(raw,
                                                                             LZ4F_freeDecompressionContext);
  return unpack(input, size, output, [&](auto in, auto out) {
    std::size_t read = in.size();
    std::size_t written = out.size();
    const std::size_t state = LZ4F_decompress(context.get(), out.data(), &written, in.data(), &read, nullptr);
    if (LZ4F_isError(state) != 0U) return Step{0, 0, false};
    return Step{read, written, state != 0};
  });
}

bool unpack_zstd(std::span<const std::uint8_t> input, std::uint64_t size, std::vector<std::uint8_t>& output) {
  const std::unique_ptr<ZSTD_DCtx, std::size_t (*)(ZSTD_DCtx*)> context(ZSTD_createDCtx(), ZSTD_freeDCtx);
  if (!context) return false;
  return unpack(input, size, output, [&](auto in, auto out) {
    ZSTD_inBuffer from{in.data(), in.size(), 0};
    ZSTD_outBuffer to{out.data(), out.size(), 0};
    const std::size_t state = ZSTD_decompressStream(context.get(), &to, &from);
    return Step{from.pos, to.pos, ZSTD_isError(state) == 0U && state != 0};
  });
}

}  // namespace

std::optional<Compression> parse_compression(std::string_view name) {
  if (name.empty() || name == "none") return Compression::kNone;
  if (name == "bz2") return Compression::kBz2;
  if (name == "lz4") return Compression::kLz4;
  if (name == "zstd") return Compression::kZstd;
  return std::nullopt;
}

bool decompress(Compression compression, std::span<const std::uint8_t> input, std::uint64_t size,
                std::vector<std::uint8_t>& output) {
  switch (compression) {
    case Compression::kBz2:
      return unpack_bz2(input, size, output);
    case Compression::kLz4:
      return unpack_lz4(input, size, output);
    case Compression::kZstd:
      return unpack_zstd(input, size, output);
    case Compression::kNone:
      break;
  }
  const auto count = static_cast<std::ptrdiff_t>(std::min<std::uint64_t>(size, input.size()));
  output.assign(input.begin(), input.begin() + count);
  return output.size() == size;
}

std::optional<std::uint64_t> zstd_content_size(std::span<const std::uint8_t> frame) {
  const unsigned long long size = ZSTD_getFrameContentSize(frame.data(), frame.size());
  if (size == ZSTD_CONTENTSIZE_UNKNOWN || size == ZSTD_CONTENTSIZE_ERROR) return std::nullopt;
  return size;
}

bool is_zstd(std::span<const std::uint8_t> bytes) {
  constexpr std::array<std::uint8_t, 4> kMagic{0x28, 0xB5, 0x2F, 0xFD};
  return bytes.size() >= kMagic.size() && std::equal(kMagic.begin(), kMagic.end(), bytes.begin());
}

}  // namespace nilio::drivers::bag
