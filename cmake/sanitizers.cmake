option(NILIO_FUZZ "Build the fuzz targets, with Clang, and the drivers that they test; nothing else" OFF)
set(NILIO_SANITIZE "" CACHE STRING "Sanitizers to build with, as -fsanitize takes them: 'address,undefined' or 'thread'")
if(NILIO_SANITIZE)
  add_compile_options(-fsanitize=${NILIO_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  add_link_options(-fsanitize=${NILIO_SANITIZE})
  if(NILIO_SANITIZE MATCHES "undefined")
    # Checks that AddressSanitizer or Clang's fuzz targets cover as well; without them GCC builds in two thirds of the time.
    add_compile_options($<$<CXX_COMPILER_ID:GNU>:-fno-sanitize=null,nonnull-attribute,returns-nonnull-attribute,object-size,pointer-overflow,vptr,alignment>)
  endif()
  # Sees ghosts in instrumented code.
  add_compile_options($<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
endif()
