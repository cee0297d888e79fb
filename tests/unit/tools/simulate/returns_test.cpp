#include "tests/support/tools/simulate_room.hpp"
#include "tools/simulate/sensors/echo.hpp"

#include <vector>

using namespace nilio;
using namespace nilio::tools::simulate;
using drivers::BlockContent;
using drivers::ReturnMode;
using drivers::VelodyneModel;
using tests::RoomWorld;

TEST_CASE("the last and the strongest of several echoes are sent", "[simulate_returns]") {
  // By reflectance over range squared: 0.02, 0.0005, 0.0008.
  const std::vector<Echo> echoes{{5.0, 0.5, 9.0}, {20.0, 0.2, 2.0}, {25.0, 0.5, 3.0}};
  const auto pair = choose_returns(echoes);
  REQUIRE(pair);
  CHECK(pair->last == 2);
  CHECK(pair->strongest == 0);
}

TEST_CASE("if the strongest echo is the last, the second strongest is sent beside it", "[simulate_returns]") {
  const std::vector<Echo> echoes{{5.0, 0.01, 2.0}, {10.0, 0.1, 3.0}, {12.0, 1.8, 50.0}};
  const auto pair = choose_returns(echoes);
  REQUIRE(pair);
  CHECK(pair->last == 2);
  CHECK(pair->strongest == 1);
}

TEST_CASE("a single echo is both returns, and no echo is no return", "[simulate_returns]") {
  const std::vector<Echo> one{{5.0, 0.5, 9.0}};
  const auto pair = choose_returns(one);
  REQUIRE(pair);
  CHECK(pair->last == 0);
  CHECK(pair->strongest == 0);
  CHECK_FALSE(choose_returns({}));
}

TEST_CASE("confidence grows with the margin of an echo, for each return separately", "[simulate_returns]") {
  const Echo faint{10.0, 0.1, 1.0};
  const Echo strong{10.0, 0.5, 100.0};
  CHECK(confidence_bits(faint, faint) == 0);
  CHECK(confidence_bits(strong, faint) == 0x000700);
  CHECK(confidence_bits(faint, strong) == 0x700000);
}

TEST_CASE(
    "the two blocks of a dual return share their azimuth, the last return is the farther, most are equal",
    "[simulate_returns]") {
  const RoomWorld world = tests::make_room_world(tests::room_drive(0.1));
  for (const VelodyneModel kind : drivers::velodyne_models()) {
    const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(kind);
    const drivers::PacketLayout* const layout = sensor.layout(ReturnMode::kDual);
    if (layout == nullptr) continue;
    INFO(sensor.name);
    const LidarModel model(sensor, tests::room_config(ReturnMode::kDual), world.trajectory, world.scene);
    // Offset from a bank's block with the last return to that with the strongest.
    const std::ptrdiff_t aside = sensor.lasers.size() == 64 ? -2 : 1;
    std::size_t same = 0;
    std::size_t different = 0;
    std::size_t wrong = 0;
    for (std::uint64_t i = 0; i < model.packet_count(); ++i) {
      const auto packet = drivers::decode(model.make_packet(i).payload);
      for (std::size_t b = 0; b < drivers::kBlocksPerPacket; ++b) {
        if (layout->contents[b] == BlockContent::kPadding) CHECK(packet->blocks[b].flag == 0);
        if (layout->contents[b] != BlockContent::kLast) continue;
        const auto& last = packet->blocks[b];
        const auto& strongest =
            packet->blocks[static_cast<std::size_t>(static_cast<std::ptrdiff_t>(b) + aside)];
        if (last.azimuth != strongest.azimuth || last.flag != strongest.flag) ++wrong;
        for (std::size_t c = 0; c < drivers::kEntriesPerBlock; ++c) {
          const auto& [far, far_intensity] = last.entries[c];
          const auto& [near, near_intensity] = strongest.entries[c];
          if (far < near || (far == near && far_intensity != near_intensity)) ++wrong;
          ++(far == near ? same : different);
        }
      }
    }
    CHECK(wrong == 0);
    CHECK(different > 20);
    CHECK(different < same / 20);
  }
}
