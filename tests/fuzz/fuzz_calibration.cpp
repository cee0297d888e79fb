// Input as a model (one byte) and its calibration file.

#include "nilio/drivers/velodyne/model.hpp"

#include "tests/fuzz/fuzz_support.hpp"

#include <cmath>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace nilio;
  if (size == 0) return 0;
  const fuzz::MemoryFile file({data + 1, size - 1});
  const drivers::VelodyneModel model = drivers::velodyne_models()[data[0] % drivers::kVelodyneModelCount];
  const drivers::VelodyneSensor built_in = drivers::make_velodyne_sensor(model);
  const auto sensor = drivers::with_calibration_file(built_in, file.path());
  if (!sensor) {
    fuzz::require(sensor.error().message.find(file.path()) != std::string::npos, "errors name the file");
    return 0;
  }
  fuzz::require(sensor->lasers.size() == built_in.lasers.size(), "the model keeps its number of lasers");
  for (const drivers::LaserCalibration& laser : sensor->lasers) {
    const double sum = laser.elevation_rad + laser.azimuth_correction_rad + laser.distance_correction_m +
                       laser.vertical_offset_m + laser.horizontal_offset_m +
                       laser.near_distance_correction_x_m + laser.near_distance_correction_y_m +
                       laser.focal_distance_m + laser.focal_slope;
    fuzz::require(std::isfinite(sum), "geometry is finite");
    fuzz::require(laser.ring < sensor->lasers.size(), "rings are ranks");
  }
  fuzz::require(std::isfinite(sensor->beam_spacing_rad), "beam spacing is finite");
  return 0;
}
