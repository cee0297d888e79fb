find_package(Catch2 2.13 REQUIRED)

# One executable per area, from the files tests/{unit,golden,replay,faults}/<area>/**/*_test.cpp.
function(nilio_add_test area)
  get_filename_component(root ${CMAKE_CURRENT_FUNCTION_LIST_DIR}/.. ABSOLUTE)
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS 
       ${root}/tests/unit/${area}/*.cpp ${root}/tests/golden/${area}/*.cpp ${root}/tests/replay/${area}/*.cpp ${root}/tests/faults/${area}/*.cpp)
  if(NOT sources)
    return()
  endif()
  if(area STREQUAL "daemon" AND NILIO_SANITIZE STREQUAL "thread")
    # The threads of the pipeline; the other tests start programs whose libraries are not instrumented, and need not be built.
    set(all ${sources})
    set(sources)
    foreach(source ${all})
      file(STRINGS ${source} found REGEX "\\[pipeline\\]")
      if(found)
        list(APPEND sources ${source})
      endif()
    endforeach()
  endif()
  add_executable(test_${area} ${sources})
  target_include_directories(test_${area} PRIVATE ${root})
  target_precompile_headers(test_${area} PRIVATE <catch2/catch.hpp>)
  target_link_libraries(test_${area} PRIVATE Catch2::Catch2WithMain nilio_test_paths nilio_options nilio_lightly_optimised ${ARGN})
  target_compile_options(test_${area} PRIVATE -g0)
  set(selection)
  if(area STREQUAL "daemon" AND NILIO_SANITIZE STREQUAL "thread")
    set(selection "[pipeline]")
  endif()
  if(area MATCHES "^(core|tools)$" AND NILIO_SANITIZE)
    # Whole drives, each several times, take ten minutes, of code that the other tests have run already.
    # Nor the soak, which is hidden: to leave something out alone would take it in.
    set(selection "~[drives]~[.]")
  endif()
  add_test(NAME ${area} COMMAND test_${area} ${selection})
  # Debian's Fast DDS deletes its statistics writers through another type, and fontconfig keeps a cache: not ours to mend.
  set_tests_properties(
    ${area} PROPERTIES TIMEOUT 1200
    ENVIRONMENT "ASAN_OPTIONS=new_delete_type_mismatch=0;LSAN_OPTIONS=suppressions=${root}/tests/lsan.supp;TSAN_OPTIONS=suppressions=${root}/tests/tsan.supp halt_on_error=1")
endfunction()
