find_package(Catch2 2.13 REQUIRED)

# Those of the sources that have a case with the tag.
function(nilio_tagged result tag)
  set(tagged)
  foreach(source ${ARGN})
    file(STRINGS ${source} found REGEX "\\[${tag}\\]")
    if(found)
      list(APPEND tagged ${source})
    endif()
  endforeach()
  set(${result} ${tagged} PARENT_SCOPE)
endfunction()

# One executable per area, from the files tests/{unit,golden,replay,faults}/<area>/**/*_test.cpp. Cases that measure wall-clock
# times have the tag [timed]: they are a test of their own, <area>_timed, which has the computer to itself.
function(nilio_add_test area)
  get_filename_component(root ${CMAKE_CURRENT_FUNCTION_LIST_DIR}/.. ABSOLUTE)
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS 
       ${root}/tests/unit/${area}/*.cpp ${root}/tests/golden/${area}/*.cpp ${root}/tests/replay/${area}/*.cpp ${root}/tests/faults/${area}/*.cpp)
  if(NOT sources)
    return()
  endif()
  # Hidden cases, like the soak: to leave something out alone would take them in.
  set(selection "~[.]")
  if(area STREQUAL "daemon" AND NILIO_SANITIZE STREQUAL "thread")
    # The threads of the pipeline; the other tests start programs whose libraries are not instrumented, and need not be built.
    nilio_tagged(sources pipeline ${sources})
    set(selection "[pipeline]")
  elseif(NILIO_SANITIZE AND (area MATCHES "^(core|tools)$" OR (area STREQUAL "mapping" AND NOT DEFINED ENV{NILIO_FULL_TESTS})))
    # Whole drives, each several times, and searches of the map that find nothing take a quarter of an hour, of code that the other
    # tests have run already.
    set(selection "~[drives]~[.]")
  endif()
  add_executable(test_${area} ${sources})
  if(area STREQUAL "dds")
    # Fast DDS has a namespace dds, too.
    set_target_properties(test_dds PROPERTIES UNITY_BUILD OFF)
  endif()
  target_include_directories(test_${area} PRIVATE ${root})
  target_precompile_headers(test_${area} PRIVATE <catch2/catch.hpp>)
  target_link_libraries(test_${area} PRIVATE Catch2::Catch2WithMain nilio_test_paths nilio_options nilio_lightly_optimised ${ARGN})
  target_compile_options(test_${area} PRIVATE -g0)
  add_test(NAME ${area} COMMAND test_${area} "${selection}~[timed]")
  set(added ${area})
  nilio_tagged(timed timed ${sources})
  if(timed)
    add_test(NAME ${area}_timed COMMAND test_${area} "${selection}[timed]")
    set_tests_properties(${area}_timed PROPERTIES LABELS timed RUN_SERIAL ON)
    list(APPEND added ${area}_timed)
  endif()
  # Debian's Fast DDS deletes its statistics writers through another type, and fontconfig keeps a cache: not ours to mend.
  set_tests_properties(
    ${added} PROPERTIES TIMEOUT 1200
    ENVIRONMENT "ASAN_OPTIONS=new_delete_type_mismatch=0;LSAN_OPTIONS=suppressions=${root}/tests/lsan.supp;TSAN_OPTIONS=suppressions=${root}/tests/tsan.supp halt_on_error=1")
endfunction()
