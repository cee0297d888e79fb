#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/bag/sources.hpp"

#include <string>
#include <vector>

namespace nilio::tools::inspect {

/// Contents of a ROS bag.
struct BagFindings {
  std::vector<std::string> files;
  drivers::BagSurvey survey;
  /// Notes of niliod about the topics that it would use, or the reason why it cannot read the bag.
  std::vector<std::string> notes;
  std::vector<std::string> warnings;
  std::string problem;
  /// A line for each topic of a GNSS receiver.
  std::vector<std::string> gnss;

  [[nodiscard]] bool usable() const { return problem.empty(); }
};

/// Reads the whole recording for its topics, and its beginning as niliod would with the default
/// configuration.
core::Result<BagFindings> inspect_bag(const std::vector<std::string>& files);

/// Text for the user.
std::string bag_report(const BagFindings& bag);

}  // namespace nilio::tools::inspect
