#include "tools/commands/commands.hpp"
#include "tools/view/view.hpp"

#include <memory>

#include <CLI/CLI.hpp>

namespace nilio::tools {

void add_view_command(CLI::App& app, int& status) {
  const auto options = std::make_shared<view::Options>();
  options->subscriber.participant.name = "nilio view";
  CLI::App* const command = app.add_subcommand(
      "view", "watch a live nilio, or look at finished runs, in a browser: map, path, latency");
  command->footer(
      "RUN is an output folder of niliod. Without one, the view is a DDS subscriber of a live niliod, and "
      "/metrics "
      "serves Prometheus. It only reads.\n\n"
      "Another --address than one of this computer's loopback asks for a token, which is part of the printed "
      "address; Prometheus sends it as a bearer token.\n\n"
      "Example: nilio view                 a live nilio on DDS domain 0\n"
      "         nilio view RUN --truth DRIVE/truth.tum");
  command->add_option("RUN", options->runs,
                      "folders of finished runs, compared side by side (default: live)");
  command->add_option("--truth", options->truths,
                      "true trajectory of the runs, TUM or KITTI: one for all, or one for each");
  command->add_option("--domain", options->subscriber.participant.domain, "DDS domain id")
      ->check(CLI::Range(0, 232))
      ->capture_default_str();
  command->add_option("--interface", options->subscriber.participant.interface_whitelist,
                      "IPv4 address of this machine on the network to use (repeatable; default: all)");
  command->add_option("--topic-prefix", options->subscriber.topic_prefix, "Prefix of the topic names");
  command->add_option("--address", options->server.address, "IP address to serve on")->capture_default_str();
  command->add_option("--port", options->server.port, "TCP port to serve on; 0: any free one")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  command->add_option(
      "--token-file", options->token_file,
      "file with the token that clients have to know (default: none on loopback, else a new one)");
  command->add_flag("!--no-browser", options->open_browser, "do not open a browser");
  command->callback([options, &status] { status = view::run(*options); });
}

}  // namespace nilio::tools
