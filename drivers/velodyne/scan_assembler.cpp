#include "nilio/drivers/velodyne/decoder.hpp"

#include "drivers/velodyne/scan_assembler_state.hpp"

#include <utility>

namespace nilio::drivers {

ScanAssembler::ScanAssembler(VelodyneSensor sensor, const ScanAssemblerConfig& config)
    : state_(std::make_unique<State>(std::move(sensor), config)) {}

ScanAssembler::ScanAssembler(ScanAssembler&&) noexcept = default;
ScanAssembler& ScanAssembler::operator=(ScanAssembler&&) noexcept = default;
ScanAssembler::~ScanAssembler() = default;

bool ScanAssembler::add(const Packet& packet) { return state_->add(packet); }
bool ScanAssembler::finish() { return state_->finish(); }
void ScanAssembler::take_scan(core::Scan& scan) { state_->take_scan(scan); }
const ScanAssemblerStats& ScanAssembler::stats() const { return state_->stats(); }
ScanAssemblerStatus ScanAssembler::status() const { return state_->status(); }
std::uint64_t ScanAssembler::open_firings() const { return state_->open_firings(); }
const Hdl64eStatusReader* ScanAssembler::hdl64e_status() const { return state_->hdl64e_status(); }
const VelodyneSensor& ScanAssembler::sensor() const { return state_->sensor(); }

}  // namespace nilio::drivers
