#include "daemon/exit_status.hpp"
#include "ipc/messages/diagnostics.hpp"
#include "tools/commands/commands.hpp"

#include <iostream>
#include <map>
#include <memory>
#include <string>

#include <CLI/CLI.hpp>

namespace nilio::tools {

namespace {

using Page = std::string (*)();

const std::map<std::string, Page> kPages{{"diagnostics", dds::diagnostic_reference},
                                         {"exit-status", exit_status_reference}};

}  // namespace

void add_reference_command(CLI::App& app, int& status) {
  const auto page = std::make_shared<std::string>();
  CLI::App* const command =
      app.add_subcommand("reference", "print a page of docs/ that is generated from the code");
  command->add_option("page", *page, "which page")->required()->check(CLI::IsMember(kPages));
  command->callback([page, &status] {
    std::cout << kPages.at(*page)();
    status = std::cout.flush() ? kDone : kFailed;
  });
}

}  // namespace nilio::tools
