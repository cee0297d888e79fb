#include "tools/commands/commands.hpp"
#include "tools/watch/watch.hpp"

#include <memory>

#include <CLI/CLI.hpp>

namespace nilio::tools {

void add_watch_command(CLI::App& app, int& status) {
  const auto options = std::make_shared<watch::Options>();
  options->subscriber.participant.name = "nilio watch";
  CLI::App* const command =
      app.add_subcommand("watch", "Show the poses that niliod publishes over DDS, and their latency");
  command->add_option("--domain", options->subscriber.participant.domain, "DDS domain id")
      ->check(CLI::Range(0, 232))
      ->capture_default_str();
  command->add_option("--interface", options->subscriber.participant.interface_whitelist,
                      "IPv4 address of this machine on the network to use (repeatable; default: all)");
  command->add_option("--topic-prefix", options->subscriber.topic_prefix, "Prefix of the topic names");
  command->add_option("--count", options->count, "End after this number of poses (default: never)");
  command
      ->add_option("--timeout", options->timeout_s,
                   "End after this many seconds without a pose (default: never)")
      ->check(CLI::NonNegativeNumber);
  command->add_option("--tum", options->tum_path, "Write the poses to this file (time x y z qx qy qz qw)");
  command->add_option("--json", options->json_path, "Write the summary to this file at the end");
  command->add_flag("--imu-rate", options->subscriber.imu_rate,
                    "Watch the poses at IMU rate instead of those of the scans");
  command->callback([options, &status] { status = watch::run(*options); });
}

}  // namespace nilio::tools
