#include "drivers/network/ipv4_address.hpp"

#include <arpa/inet.h>
#include <array>
#include <netinet/in.h>

namespace nilio::drivers {

std::string format_ipv4(std::uint32_t address) {
  std::array<char, INET_ADDRSTRLEN> text{};
  const in_addr network{htonl(address)};
  inet_ntop(AF_INET, &network, text.data(), text.size());
  return text.data();
}

core::Result<std::uint32_t> parse_ipv4(const std::string& text, const std::string& use) {
  in_addr address{};
  if (inet_pton(AF_INET, text.c_str(), &address) != 1) {
    return core::Error{"'" + text + "' is no IPv4 address for the " + use + "; write it as 192.168.1.201"};
  }
  return ntohl(address.s_addr);
}

core::Result<std::uint32_t> parse_optional_ipv4(const std::string& text, const std::string& use) {
  if (text.empty()) return std::uint32_t{0};
  return parse_ipv4(text, use);
}

}  // namespace nilio::drivers
