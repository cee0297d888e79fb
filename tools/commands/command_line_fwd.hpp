#pragma once

// CLI11 takes long to compile: only what defines a command includes it.
namespace CLI {
class App;
}
