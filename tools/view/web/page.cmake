# The page of `nilio view`, bundled from npm packages of exact versions into one compressed HTML file. Sets
# NILIO_VIEW_PAGE to its path; without node and npm it stays unset, and the program says so.
find_program(NILIO_NODE NAMES node nodejs)
find_program(NILIO_NPM npm)
option(NILIO_VIEW "Build the page of nilio view where npm is found" ON)
set(NILIO_VIEW_PAGE)
if(NOT NILIO_VIEW OR NOT NILIO_NODE OR NOT NILIO_NPM)
  message(STATUS "nilio view, nilio report --html: the page is left out, npm was not found; everything else is built")
  return()
endif()

set(NILIO_VIEW_BUILD ${CMAKE_BINARY_DIR}/view)
set(NILIO_VIEW_PAGE ${NILIO_VIEW_BUILD}/page.html.gz)
set(web ${CMAKE_CURRENT_SOURCE_DIR}/view/web)
file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${web}/src/*)
# Packages are fetched again only when their versions change. No script of a package is run.
add_custom_command(
  OUTPUT ${NILIO_VIEW_BUILD}/packages.stamp
  DEPENDS ${web}/package.json ${web}/package-lock.json
  COMMAND ${CMAKE_COMMAND} -E make_directory ${NILIO_VIEW_BUILD}
  COMMAND ${CMAKE_COMMAND} -E copy ${web}/package.json ${web}/package-lock.json ${NILIO_VIEW_BUILD}
  COMMAND ${NILIO_NPM} ci --ignore-scripts --no-audit --no-fund --loglevel=error
  COMMAND ${CMAKE_COMMAND} -E touch ${NILIO_VIEW_BUILD}/packages.stamp
  WORKING_DIRECTORY ${NILIO_VIEW_BUILD}
  COMMENT "Fetching the packages of the page of nilio view")
add_custom_command(
  OUTPUT ${NILIO_VIEW_PAGE}
  DEPENDS ${sources} ${web}/build.mjs ${NILIO_VIEW_BUILD}/packages.stamp
  COMMAND ${NILIO_NODE} ${web}/build.mjs ${web}/src ${NILIO_VIEW_BUILD}
  WORKING_DIRECTORY ${NILIO_VIEW_BUILD}
  COMMENT "Bundling the page of nilio view")
