#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

namespace nilio::tests {

/// First of eight DDS domains of this process: no other test that runs has them, as their name, a socket's,
/// is taken.
inline std::uint32_t first_test_domain() {
  constexpr std::uint32_t kDomains = 8;
  const int name = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  for (std::uint32_t domain = 100;; domain += kDomains) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    const std::string text = "nilio-test-domain-" + std::to_string(domain);
    std::memcpy(address.sun_path + 1, text.data(), text.size());
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + text.size());
    if (domain + kDomains > 200 || bind(name, reinterpret_cast<const sockaddr*>(&address), size) == 0)
      return domain;
  }
}

/// Another domain for every test, so that the participants of the last one do not disturb.
inline std::uint32_t test_domain() {
  static const std::uint32_t first = first_test_domain();
  static std::uint32_t tests = 0;
  return first + tests++ % 8;
}

}  // namespace nilio::tests
