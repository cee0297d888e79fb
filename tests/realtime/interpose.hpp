#pragma once

#include "tests/realtime/watch.hpp"

/// Interface between the replaced functions and the watch.
namespace nilio::tests::interpose {

/// Counts the offence if the calling thread is watched.
void called(Offence offence);
/// Role of the calling thread, inherited by the threads it starts; -1 if it is not watched.
int role_to_inherit();
/// First call in a thread started by a watched thread.
void begin_worker(int role);

}  // namespace nilio::tests::interpose
