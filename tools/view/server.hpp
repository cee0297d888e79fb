#pragma once

#include "nilio/core/result.hpp"

#include "tools/view/frames.hpp"

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace nilio::tools::view {

/// Whether only this computer reaches the address.
bool is_loopback(const std::string& address);

/// Answer to a GET request.
struct Response {
  std::string content_type;
  std::shared_ptr<const std::string> body;
  bool gzip = false;  ///< the body is compressed; sent as it is to clients that accept it
  std::string security_policy;
};

/// One page that is connected by WebSocket. Text is delivered in order, within a limit; pictures of the
/// moment are asked for when the connection has room, so that a slow client gets fewer of them.
class PageClient {
 public:
  /// Text that may wait for one client.
  static constexpr std::size_t kMaxWaiting = 256 * 1024;

  void send(const std::shared_ptr<const std::string>& text);
  /// Where the source of the frames stopped for this client.
  struct Progress {
    std::uint64_t scan = 0;
    std::uint64_t path_generation = 0;
    std::size_t path_vertices = 0;
    std::map<std::uint32_t, std::size_t> tile_points;
    std::uint64_t drive = 0;
    std::uint64_t row = 0;
    std::uint64_t event = 0;
    bool greeted = false;
  };
  Progress progress;

 private:
  friend class Server;
  std::deque<std::shared_ptr<Frame>> texts_;
  std::size_t waiting_ = 0;
  bool overflowed_ = false;
  bool admitted_ = false;
  std::int64_t since_ns_ = 0;           ///< connected
  std::int64_t writable_asked_ns_ = 0;  ///< 0: not waiting for room
};

/// Source of the answers of a server. Called by the server's thread only.
class Content {
 public:
  Content() = default;
  Content(const Content&) = delete;
  Content& operator=(const Content&) = delete;
  virtual ~Content() = default;
  /// Names of a fixed table; unset: unknown. `accept`: the request's header.
  virtual std::optional<Response> get(std::string_view path, std::string_view accept) = 0;
  /// The next frame for this client, if there is one that it does not have yet.
  virtual FramePtr next_frame(PageClient& client) = 0;
  /// Every 50 ms.
  virtual void tick(std::vector<PageClient*>& clients) = 0;
};

/// Counters of the server, since its start.
struct ServerCounts {
  std::size_t clients = 0;
  std::uint64_t requests = 0;
  std::uint64_t refused = 0;       ///< no place, wrong host, origin or token
  std::uint64_t slow_clients = 0;  ///< dropped
  std::uint64_t frames_sent = 0;
  std::uint64_t bytes_sent = 0;
};

/// HTTP and WebSocket server with a fixed table of names; one thread. GET and HEAD only. Bounded: sockets,
/// pages, size and time of a request head, and what waits for a client. When all sockets are taken, the
/// oldest one without a complete request is closed.
class Server {
 public:
  static constexpr std::size_t kMaxClients = 8;
  static constexpr int kMaxSockets = 256;
  static constexpr std::size_t kMaxWithoutRequest = 128;

  struct Options {
    std::string address = "127.0.0.1";
    std::uint16_t port = 8480;  ///< 0: any free one
    std::string token;          ///< empty: none is asked for
  };

  /// Fails when the address or port cannot be used; the message says what to do.
  static core::Result<std::unique_ptr<Server>> create(const Options& options, Content& content);
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  [[nodiscard]] std::uint16_t port() const;
  [[nodiscard]] const ServerCounts& counts() const;
  /// Serves until `stop` returns true; it is asked every 50 ms.
  void run(const std::function<bool()>& stop);

 private:
  struct Implementation;
  explicit Server(std::unique_ptr<Implementation> implementation);
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace nilio::tools::view
