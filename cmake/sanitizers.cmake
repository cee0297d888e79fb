option(NILIO_FUZZ "Build the fuzz targets, with Clang, and the drivers that they test; nothing else" OFF)
set(NILIO_SANITIZE "" CACHE STRING "Sanitizers to build with, as -fsanitize takes them: 'address,undefined' or 'thread'")
if(NILIO_SANITIZE)
  add_compile_options(-fsanitize=${NILIO_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  add_link_options(-fsanitize=${NILIO_SANITIZE})
  # Sees ghosts in instrumented code.
  add_compile_options($<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
endif()
