#include "drivers/network/interfaces.hpp"

#include <arpa/inet.h>
#include <array>
#include <bit>
#include <fstream>
#include <ifaddrs.h>
#include <map>
#include <memory>
#include <net/if.h>
#include <netinet/in.h>

namespace nilio::drivers {
namespace {

constexpr const char* kSysfs = "/sys/class/net";

struct InterfaceListCloser {
  void operator()(ifaddrs* list) const { freeifaddrs(list); }
};

std::string read_word(const std::filesystem::path& path) {
  std::string word;
  std::ifstream(path) >> word;
  return word;
}

std::uint32_t ipv4_of(const sockaddr* address) {
  return ntohl(reinterpret_cast<const sockaddr_in*>(address)->sin_addr.s_addr);
}

struct Interface {
  bool is_loopback = false;
  /// "192.168.1.10/24, ..."
  std::string networks;
  bool is_wanted = false;
};

std::map<std::string, Interface> list_interfaces(const std::string& wanted) {
  std::map<std::string, Interface> interfaces;
  ifaddrs* first = nullptr;
  if (getifaddrs(&first) != 0) return interfaces;
  const std::unique_ptr<ifaddrs, InterfaceListCloser> list(first);
  for (const ifaddrs* entry = list.get(); entry != nullptr; entry = entry->ifa_next) {
    Interface& interface = interfaces[entry->ifa_name];
    interface.is_loopback = (entry->ifa_flags & IFF_LOOPBACK) != 0;
    if (wanted == entry->ifa_name) interface.is_wanted = true;
    if (entry->ifa_addr == nullptr || entry->ifa_addr->sa_family != AF_INET) continue;
    const std::string address = format_ipv4(ipv4_of(entry->ifa_addr));
    if (address == wanted) interface.is_wanted = true;
    const int prefix = entry->ifa_netmask != nullptr ? std::popcount(ipv4_of(entry->ifa_netmask)) : 32;
    interface.networks += (interface.networks.empty() ? "" : ", ") + address + "/" + std::to_string(prefix);
  }
  return interfaces;
}

/// Virtual interfaces have no device; they can receive only with an address.
bool has_device(const std::string& name) {
  std::error_code ignored;
  return std::filesystem::exists(std::filesystem::path(kSysfs) / name / "device", ignored);
}

std::string describe(const std::string& name, const Interface& interface) {
  return name + " (" + (interface.networks.empty() ? "no IPv4 address" : interface.networks) +
         "): " + describe_link(name, kSysfs);
}

}  // namespace

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

std::string describe_link(const std::string& interface, const std::filesystem::path& sysfs) {
  const std::string state = read_word(sysfs / interface / "operstate");
  // Reading the carrier fails while the interface is switched off.
  const std::string carrier = read_word(sysfs / interface / "carrier");
  if (carrier == "1") return state == "dormant" ? "link up, but waiting for authentication" : "link up";
  if (carrier == "0") return "no link: check the cable and the sensor's power";
  if (state.empty()) return "state unknown";
  return "switched off: 'ip link set " + interface + " up' switches it on";
}

std::string describe_interfaces(const std::string& wanted) {
  const bool all = wanted.empty() || wanted == "0.0.0.0";
  std::string text;
  for (const auto& [name, interface] : list_interfaces(wanted)) {
    const bool is_candidate = !interface.is_loopback && (!interface.networks.empty() || has_device(name));
    if (all ? !is_candidate : !interface.is_wanted) continue;
    text += (text.empty() ? "" : "; ") + describe(name, interface);
  }
  if (!text.empty()) return text;
  return all ? "this computer has no network interface" : "no interface has " + wanted + " any more";
}

}  // namespace nilio::drivers
