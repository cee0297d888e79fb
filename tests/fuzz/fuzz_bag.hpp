#pragma once

#include "nilio/drivers/bag/bag.hpp"
#include "nilio/drivers/bag/messages.hpp"
#include "nilio/drivers/bag/point_cloud.hpp"

#include "tests/fuzz/fuzz_support.hpp"

#include <vector>

namespace nilio::fuzz {

/// Reads all messages and decodes those of known types.
inline void read_bag(drivers::BagReader& reader) {
  std::vector<drivers::Packet> packets;
  std::vector<drivers::BagTransform> transforms;
  std::vector<drivers::CloudCopy> clouds;
  drivers::CloudView view;
  while (const auto message = reader.next()) {
    require(message->topic < reader.topics().size(), "every message has a topic");
    const drivers::BagTopic& topic = reader.topics()[message->topic];
    // Whatever the type says, each decoder has to stand each message.
    decode_imu(topic, *message);
    decode_fix(topic, *message);
    decode_sentence(topic, *message);
    decode_can_frame(topic, *message);
    decode_pose(topic, *message);
    packets.clear();
    decode_packets(topic, *message, packets);
    transforms.clear();
    decode_transforms(topic, *message, transforms);
    if (!decode_cloud(topic, *message, view)) continue;
    if (clouds.size() < 4 && view.data.size() < 65'536) clouds.emplace_back(view);
  }
  require(reader.notes().size() <= drivers::BagReader::kMaxNotes, "notes are bounded");
  auto decoder = drivers::CloudDecoder::create(clouds, "fuzzed");
  if (!decoder) return;
  core::Scan scan;
  for (const drivers::CloudCopy& cloud : clouds) {
    if (!decoder->decode(cloud.view, scan)) continue;
    require(scan.start <= scan.end && scan.points.size() <= cloud.view.points, "scans are consistent");
  }
}

}  // namespace nilio::fuzz
