#pragma once

#include "ipc/dds/odometry_subscriber.hpp"
#include "tools/view/server.hpp"

#include <string>
#include <vector>

namespace nilio::tools::view {

/// Options of "nilio view".
struct Options {
  std::vector<std::string> runs;  ///< folders; none: live
  std::vector<std::string> truths;
  dds::OdometrySubscriberConfig subscriber;
  Server::Options server;
  std::string token_file;
  bool open_browser = true;
};

/// Serves the page until SIGINT (exit status 130) or SIGTERM (0). Returns the exit status; failures are told
/// on standard error.
int run(const Options& options);

}  // namespace nilio::tools::view
