#include "tools/view/live_content.hpp"

#include "nilio/core/clock.hpp"

#include "tools/view/metrics.hpp"
#include "tools/view/run_content.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

#include <nlohmann/json.hpp>

namespace nilio::tools::view {

namespace {

using nlohmann::json;

constexpr std::int64_t kStateNs = 100'000'000;
constexpr std::int64_t kSummaryNs = 1'000'000'000;
constexpr std::int64_t kKeepCloudsNs = 60'000'000'000;
constexpr std::size_t kPathVerticesPerFrame = 8192;

std::string place_of(const dds::OdometrySubscriberConfig& config) {
  std::string place = "DDS domain " + std::to_string(config.participant.domain);
  if (!config.topic_prefix.empty()) place += ", topic prefix " + config.topic_prefix;
  return place;
}

/// More than any sensor's scan; the rest is left out.
constexpr std::size_t kMaxPoints = 1'000'000;

std::optional<std::size_t> offset_of(const dds::PointCloud2& cloud, std::string_view name) {
  for (const dds::PointField& field : cloud.fields) {
    if (field.name == name && field.datatype == dds::PointField::kFloat32 &&
        std::uint64_t{field.offset} + sizeof(float) <= cloud.point_step)
      return field.offset;
  }
  return std::nullopt;
}

}  // namespace

LiveContent::LiveContent(std::unique_ptr<dds::OdometrySubscriber> subscriber,
                         const dds::OdometrySubscriberConfig& config)
    : subscriber_(std::move(subscriber)),
      cloud_config_{config.participant, config.topic_prefix},
      state_(place_of(config)),
      tiles_({}),
      place_(place_of(config)) {
  cloud_config_.participant.name += " clouds";
  state_.tick(monotonic_ns());
}

void LiveContent::subscribe_to_clouds(bool has_clients) {
  const std::int64_t now = monotonic_ns();
  if (has_clients) last_client_ns_ = now;
  if (has_clients && !clouds_) {
    auto clouds = dds::CloudSubscriber::create(cloud_config_);
    if (clouds) {
      clouds_ = std::move(clouds).value();
    } else {
      state_.note("error", clouds.error().message);
    }
  }
  if (!has_clients && now - last_client_ns_ > kKeepCloudsNs) clouds_.reset();
}

void LiveContent::receive_clouds() {
  if (!clouds_) return;
  if (const auto path = clouds_->take_path()) state_.add(*path);
  const auto scan = clouds_->take_scan();
  if (!scan || !state_.pose()) return;
  const std::vector<ViewPoint> points = points_of(*scan);
  for (const ViewPoint& point : points) tiles_.add(point.position, point.intensity);
  scan_ = scan_frame(points, state_.pose()->message.position, state_.drive_time_s(scan->stamp));
  ++scan_number_;
}

std::optional<Response> LiveContent::get(std::string_view path, std::string_view accept) {
  if (path == "/") return page_response();
  if (path == "/metrics") {
    const MetricsFormat format = metrics_format(accept);
    const ServerCounts counts = server_ == nullptr ? ServerCounts{} : server_->counts();
    return Response{
        .content_type = content_type_of(format),
        .body = std::make_shared<const std::string>(metrics_text(state_, counts, tiles_.points(), format)),
        .security_policy = {}};
  }
  if (path == "/mode.json")
    return Response{.content_type = "application/json",
                    .body = std::make_shared<const std::string>(R"({"mode":"live"})"),
                    .security_policy = {}};
  return std::nullopt;
}

void LiveContent::receive() {
  state_.set(subscriber_->counts());
  // A pose follows its report or precedes it; reports first, so that the pose has its state.
  for (const dds::ScanReport& report : subscriber_->scan_reports()) state_.add(report);
  while (const auto sample = subscriber_->next({})) state_.add(*sample);
  if (const auto latency = subscriber_->latency_report()) state_.set(*latency);
  if (const auto diagnostics = subscriber_->diagnostics()) state_.set(*diagnostics);
  if (drive_ != state_.drive()) {
    drive_ = state_.drive();
    tiles_.clear();
    scan_.reset();
  }
}

void LiveContent::send(PageClient& client, const json& message) const {
  client.send(
      std::make_shared<const std::string>(message.dump(-1, ' ', false, json::error_handler_t::replace)));
}

void LiveContent::greet(PageClient& client) const {
  send(client, {{"type", "hello"},
                {"version", NILIO_VERSION},
                {"place", place_},
                {"columns", LiveState::column_names()}});
  send(client, state_.summary_json());
  client.progress.greeted = true;
}

void LiveContent::tick(std::vector<PageClient*>& clients) {
  subscribe_to_clouds(!clients.empty());
  receive();
  receive_clouds();
  const std::int64_t now = monotonic_ns();
  state_.tick(now);
  const bool state_due = now >= next_state_ns_;
  const bool summary_due = now >= next_summary_ns_;
  if (state_due) next_state_ns_ = now + kStateNs;
  if (summary_due) next_summary_ns_ = now + kSummaryNs;
  if (clients.empty() || !state_due) return;
  const json state = state_.state_json();
  const json summary = summary_due ? state_.summary_json() : json();
  for (PageClient* const client : clients) {
    if (!client->progress.greeted) greet(*client);
    send(*client, state);
    if (summary_due) send(*client, summary);
    if (json rows = state_.scan_rows(client->progress.row); !rows.empty())
      send(*client, {{"type", "rows"}, {"rows", std::move(rows)}});
    if (state_.last_event() > client->progress.event) {
      send(*client, state_.events_json(client->progress.event + 1));
      client->progress.event = state_.last_event();
    }
  }
}

FramePtr LiveContent::next_frame(PageClient& client) {
  PageClient::Progress& progress = client.progress;
  if (!progress.greeted) return nullptr;
  if (scan_ && progress.scan != scan_number_) {
    progress.scan = scan_number_;
    return scan_;
  }
  const LivePath& path = state_.path();
  const bool anew = progress.path_generation != path.generation();
  if (anew) progress.path_vertices = 0;
  if (anew || progress.path_vertices < path.vertices().size()) {
    progress.path_generation = path.generation();
    const std::span<const PathVertex> rest = std::span(path.vertices()).subspan(progress.path_vertices);
    const auto part = rest.first(std::min(rest.size(), kPathVerticesPerFrame));
    progress.path_vertices += part.size();
    return path_frame(part, anew);
  }
  for (const auto& [id, sent] : progress.tile_points) {
    if (tiles_.tiles().contains(id)) continue;
    const FrameHeader header{.kind = FrameKind::kTileDropped, .id = id};
    progress.tile_points.erase(id);
    return std::make_shared<Frame>(header, std::span<const std::uint8_t>());
  }
  for (const auto& [id, tile] : tiles_.tiles()) {
    std::size_t& sent = progress.tile_points[id];
    if (sent >= tile.points.size()) continue;
    const std::size_t first = std::exchange(sent, tile.points.size());
    const float time_s = state_.pose() ? state_.drive_time_s(state_.pose()->message.stamp) : 0.0F;
    return tile_frame(tile, first, PointValue::kIntensity, time_s);
  }
  return nullptr;
}

std::vector<ViewPoint> points_of(const dds::PointCloud2& cloud) {
  const auto x = offset_of(cloud, "x");
  const auto y = offset_of(cloud, "y");
  const auto z = offset_of(cloud, "z");
  const auto intensity = offset_of(cloud, "intensity");
  const std::uint64_t row = std::uint64_t{cloud.point_step} * cloud.width;
  // Products of 32-bit numbers do not overflow 64 bits.
  if (!x || !y || !z || cloud.is_bigendian || row > cloud.row_step ||
      std::uint64_t{cloud.row_step} * cloud.height != cloud.data.size())
    return {};
  std::vector<ViewPoint> points;
  points.reserve(std::min<std::uint64_t>(std::uint64_t{cloud.width} * cloud.height, kMaxPoints));
  const auto read = [&cloud](std::size_t at) {
    float value = 0.0F;
    std::memcpy(&value, cloud.data.data() + at, sizeof value);
    return value;
  };
  for (std::uint32_t v = 0; v < cloud.height; ++v) {
    for (std::uint32_t u = 0; u < cloud.width && points.size() < kMaxPoints; ++u) {
      const std::size_t at = std::size_t{v} * cloud.row_step + std::size_t{u} * cloud.point_step;
      ViewPoint point{.position = {read(at + *x), read(at + *y), read(at + *z)}};
      if (!std::ranges::all_of(point.position, [](float value) { return std::isfinite(value); })) continue;
      if (intensity) {
        const float value = read(at + *intensity);
        point.intensity =
            static_cast<std::uint8_t>(std::isfinite(value) ? std::clamp(value, 0.0F, 255.0F) : 0.0F);
      }
      points.push_back(point);
    }
  }
  return points;
}

}  // namespace nilio::tools::view
