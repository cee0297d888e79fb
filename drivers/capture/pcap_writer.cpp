#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/capture/pcap_format.hpp"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <vector>

namespace nilio::drivers {
namespace {

/// 192.168.1.201, a Velodyne's address from the factory.
constexpr std::uint32_t kSensorAddress = 0xC0A801C9;

}  // namespace

struct PcapWriter::State {
  explicit State(std::FILE* opened) : file(opened) {}
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() {
    if (file != nullptr) std::fclose(file);
  }

  bool put_record() {
    good = good && file != nullptr && std::fwrite(record.data(), 1, record.size(), file) == record.size();
    return good;
  }

  std::FILE* file;
  bool good = true;
  std::vector<std::uint8_t> record;
};

PcapWriter::PcapWriter(std::unique_ptr<State> state) : state_(std::move(state)) {}
PcapWriter::PcapWriter(PcapWriter&&) noexcept = default;
PcapWriter& PcapWriter::operator=(PcapWriter&&) noexcept = default;
PcapWriter::~PcapWriter() = default;

core::Result<PcapWriter> PcapWriter::create(const std::string& path) {
  std::FILE* file = std::fopen(path.c_str(), "wbe");
  if (file == nullptr) {
    return core::Error{path + ": cannot be written (" + std::strerror(errno) +
                       "); check the folder and its permissions"};
  }
  auto state = std::make_unique<State>(file);
  append_pcap_header(state->record);
  if (!state->put_record()) return core::Error{path + ": cannot be written; is the disk full?"};
  return PcapWriter(std::move(state));
}

bool PcapWriter::write(core::Time stamp, std::uint16_t port, std::span<const std::uint8_t> payload) {
  UdpEndpoints endpoints;
  endpoints.sender_address = kSensorAddress;
  endpoints.sender_port = port;
  endpoints.destination_port = port;
  state_->record.clear();
  return append_pcap_record(state_->record, stamp, endpoints, payload) && state_->put_record();
}

bool PcapWriter::close() {
  if (state_->file == nullptr) return state_->good;
  const bool closed = std::fclose(state_->file) == 0;
  state_->file = nullptr;
  state_->good = state_->good && closed;
  return state_->good;
}

}  // namespace nilio::drivers
