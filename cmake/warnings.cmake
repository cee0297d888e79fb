# One interface target carries the language level, the warnings and the floating-point rules of every nilio target.
add_library(nilio_options INTERFACE)
target_compile_features(nilio_options INTERFACE cxx_std_20)
target_compile_options(
  nilio_options
  INTERFACE -Wall
            -Wextra
            -Wpedantic
            -Werror
            -Wconversion
            -Wshadow
            -Wcast-align
            -Wnon-virtual-dtor
            -Woverloaded-virtual
            -Wnull-dereference
            # GCC 12 reports overlaps in std::string concatenation that cannot happen (GCC bug 105651).
            -Wno-restrict
            # Contracted multiply-adds would make results differ between machines.
            -ffp-contract=off)
