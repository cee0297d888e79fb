#pragma once

#include "tests/realtime/watch.hpp"

/// Between the replaced functions and the watch.
namespace nilio::tests::interpose {

/// Counts, if the calling thread is watched.
void called(Offence offence);
/// Of the calling thread, for the threads that it starts; -1 when it is not watched.
int role_to_inherit();
/// First thing in a thread that a watched one has started.
void begin_worker(int role);

}  // namespace nilio::tests::interpose
