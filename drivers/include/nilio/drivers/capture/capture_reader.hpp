#pragma once

#include "nilio/core/result.hpp"

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace nilio::drivers {

/// A record of a capture file.
struct CapturedFrame {
  /// Value of libpcap's DLT_*.
  int link_type = 0;
  std::int64_t stamp_ns = 0;
  /// What was kept of the frame; valid until the next record is read.
  std::span<const std::uint8_t> bytes;
  /// The frame on the wire was longer.
  bool is_cut = false;
  /// Of the network interface; empty where the file has none. Valid as long as the reader.
  std::string_view interface_name{};
  /// The machine that captured has this byte order. Only pcapng says it.
  bool big_endian_host = false;
};

enum class CaptureRead {
  kFrame,
  kSkipped,    ///< a record that makes no sense by itself; the next one may
  kEnd,        ///< regular end of the file
  kTruncated,  ///< the file ends in the middle of a record
  kDamaged,    ///< nothing after this can be found; problem() says why
};

/// A capture file of one format. One thread. next() does not allocate once the largest frame was seen.
class CaptureReader {
 public:
  CaptureReader() = default;
  CaptureReader(const CaptureReader&) = delete;
  CaptureReader& operator=(const CaptureReader&) = delete;
  virtual ~CaptureReader() = default;

  virtual CaptureRead next(CapturedFrame& frame) = 0;
  [[nodiscard]] virtual std::string problem() const = 0;
};

struct FileCloser {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using FileHandle = std::unique_ptr<std::FILE, FileCloser>;

/// What is looked for in a capture: link types that do not carry it are refused.
enum class CaptureContent { kUdp, kCan };

/// Both take a file at its beginning and fail with what is wrong with it, without its name. pcapng is read
/// here and not by libpcap, which refuses files whose interfaces have different link types.
core::Result<std::unique_ptr<CaptureReader>> open_classic_capture(FileHandle file, CaptureContent content);
core::Result<std::unique_ptr<CaptureReader>> open_pcapng_capture(FileHandle file);

/// The byte with which pcapng files begin and classic ones do not.
inline constexpr int kPcapngFirstByte = 0x0A;

/// Either by what the file is. Fails with what, where and what to do for files that are missing, empty or no
/// capture.
core::Result<std::unique_ptr<CaptureReader>> open_capture(const std::string& path,
                                                          CaptureContent content = CaptureContent::kUdp);

/// "EN10MB" or the number.
std::string link_type_name(int link_type);

}  // namespace nilio::drivers
