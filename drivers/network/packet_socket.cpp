#include "drivers/network/packet_socket.hpp"

#include <linux/filter.h>
#include <linux/if_ether.h>
#include <linux/if_packet.h>
#include <netinet/in.h>

namespace nilio::drivers {
namespace {

constexpr std::uint32_t kProtocolUdp = 17;

sock_filter statement(int code, std::uint32_t k) { return {static_cast<std::uint16_t>(code), 0, 0, k}; }

/// `yes` and `no` count the instructions that are skipped.
sock_filter jump(int code, std::uint32_t k, std::uint8_t yes, std::uint8_t no) {
  return {static_cast<std::uint16_t>(BPF_JMP | code | BPF_K), yes, no, k};
}

}  // namespace

FileDescriptor open_packet_socket(const DatagramFilter& filter) {
  std::array instructions{statement(BPF_LD | BPF_B | BPF_ABS, 9),
                          jump(BPF_JEQ, kProtocolUdp, 0, 7),
                          statement(BPF_LD | BPF_H | BPF_ABS, 6),
                          jump(BPF_JSET, 0x3FFF, 5, 0),
                          statement(BPF_LDX | BPF_B | BPF_MSH, 0),
                          statement(BPF_LD | BPF_H | BPF_IND, static_cast<std::uint32_t>(filter.field)),
                          jump(BPF_JEQ, filter.values[0], 1, 0),
                          jump(BPF_JEQ, filter.values[1], 0, 1),
                          statement(BPF_RET | BPF_K, filter.kept_bytes),
                          statement(BPF_RET | BPF_K, 0)};
  // Protocol 0 receives nothing until bind(), when the filter is in place.
  FileDescriptor socket(::socket(AF_PACKET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const sock_fprog program{.len = static_cast<unsigned short>(instructions.size()),
                           .filter = instructions.data()};
  if (!socket.is_open() || set_socket_option(socket.get(), SOL_SOCKET, SO_ATTACH_FILTER, program))
    return socket;
  return {};
}

bool start_packet_socket(const FileDescriptor& socket) {
  sockaddr_ll all{};
  all.sll_family = AF_PACKET;
  all.sll_protocol = htons(ETH_P_IP);
  return bind(socket.get(), reinterpret_cast<const sockaddr*>(&all), sizeof(all)) == 0;
}

}  // namespace nilio::drivers
