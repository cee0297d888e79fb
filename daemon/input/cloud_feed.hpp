#pragma once

#include "nilio/drivers/bag/point_cloud.hpp"
#include "nilio/drivers/bag/sources.hpp"

#include "daemon/input/scan_feed.hpp"

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace nilio::daemon {

/// Scans from recorded point clouds. Clouds without a return and clouds whose time goes back are skipped and
/// counted as partial scans.
class CloudScanFeed : public ScanFeed {
 public:
  /// Reads the first clouds and learns their layout. `name` names the topic in messages.
  static core::Result<std::unique_ptr<CloudScanFeed>> create(std::unique_ptr<drivers::CloudSource> clouds,
                                                             const std::string& name,
                                                             drivers::PointTimes times);

  FeedState next(core::Scan& scan, core::Duration timeout) override;
  void set_pace(std::int64_t start_ns) override { start_ns_ = start_ns; }
  [[nodiscard]] drivers::ScanAssemblerStats stats() const override { return stats_; }
  [[nodiscard]] std::vector<std::string> skipped() const override;
  [[nodiscard]] const drivers::CloudDecoder& decoder() const { return decoder_; }
  /// End of the first scan.
  [[nodiscard]] std::optional<core::Time> first_stamp() const { return first_stamp_; }

 private:
  CloudScanFeed(std::unique_ptr<drivers::CloudSource> clouds, std::string name,
                std::deque<drivers::CloudCopy> head, drivers::CloudDecoder decoder);
  /// Decodes the next usable cloud; false at the end.
  bool load(core::Scan& scan);

  std::unique_ptr<drivers::CloudSource> clouds_;
  std::string name_;
  /// Clouds read for learning and not delivered yet.
  std::deque<drivers::CloudCopy> head_;
  drivers::CloudDecoder decoder_;
  drivers::CloudView view_;
  drivers::ScanAssemblerStats stats_;
  std::optional<core::Time> first_stamp_;
  std::optional<core::Time> last_end_;
  /// Decoded and not due yet.
  core::Scan held_;
  bool has_held_ = false;
  std::uint64_t sequence_ = 0;
  std::optional<std::int64_t> start_ns_;
};

}  // namespace nilio::daemon
