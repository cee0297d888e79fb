# One interface target carries the language level, the warnings and the floating-point rules of every nilio target.
add_library(nilio_options INTERFACE)
# Instrumented code looks to GCC as if it dereferenced null pointers.
set(NILIO_NULL_DEREFERENCE -Wnull-dereference)
if(NILIO_SANITIZE)
  set(NILIO_NULL_DEREFERENCE)
endif()
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
            ${NILIO_NULL_DEREFERENCE}
            # GCC 12 reports overlaps in std::string concatenation that cannot happen (GCC bug 105651).
            $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>
            # Part of -Wconversion for Clang, not for GCC.
            $<$<CXX_COMPILER_ID:Clang>:-Wno-sign-conversion>
            # Contracted multiply-adds would make results differ between machines.
            -ffp-contract=off)

# For code that does not compute for long: it compiles several times faster so. With so little optimisation GCC sees null
# pointers in the standard library. Linked after nilio_options, because it overrides two of its warnings.
add_library(nilio_lightly_optimised INTERFACE)
target_compile_options(nilio_lightly_optimised INTERFACE -O1 -Wno-null-dereference -Wno-array-bounds)
