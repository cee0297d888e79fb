// Input as the HDL-64E's status stream: pairs of type and value, with losses.

#include "nilio/drivers/velodyne/hdl64e/status.hpp"

#include "tests/fuzz/fuzz_support.hpp"

#include <cmath>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace nilio;
  drivers::Hdl64eStatusReader reader;
  for (std::size_t i = 0; i + 1 < size; i += 2) {
    if (data[i] == 0) {
      reader.note_loss();
    } else {
      reader.add(data[i], data[i + 1]);
    }
  }
  const auto& calibration = reader.calibration();
  if (!calibration) return 0;
  for (const drivers::LaserCalibration& laser : calibration->lasers) {
    const double sum = laser.elevation_rad + laser.azimuth_correction_rad + laser.distance_correction_m +
                       laser.vertical_offset_m + laser.horizontal_offset_m + laser.focal_distance_m +
                       laser.focal_slope;
    fuzz::require(std::isfinite(sum), "geometry is finite");
  }
  return 0;
}
