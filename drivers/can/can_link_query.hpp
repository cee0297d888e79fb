#pragma once

#include "drivers/can/socketcan/state.hpp"

namespace nilio::drivers {

/// Fills in what the interface's driver tells over rtnetlink: nothing for virtual buses. By hand, since
/// libsocketcan waits for ever when the interface vanishes while it is asked, which is the rule rather than
/// the exception when an adapter is unplugged, and complains on standard error about what a driver does not
/// know. Waits at most 0.3 s for the answer; `silent` is set when there is none.
void ask_can_driver(CanInterfaceState& state);

}  // namespace nilio::drivers
