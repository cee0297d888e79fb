# Files that programs and libraries need beside them: configuration, units, man pages, completion, licence.
set(share ${CMAKE_INSTALL_DATADIR})
install(DIRECTORY config/ DESTINATION ${share}/nilio COMPONENT runtime)
install(FILES LICENSE README.md CHANGELOG.md DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT runtime)
install(DIRECTORY docs/ DESTINATION ${CMAKE_INSTALL_DOCDIR}/docs COMPONENT runtime FILES_MATCHING PATTERN "*.md"
        PATTERN results EXCLUDE PATTERN man EXCLUDE)
foreach(program nilio niliod)
  install(FILES cmake/package/completion.bash DESTINATION ${share}/bash-completion/completions RENAME ${program} COMPONENT runtime)
endforeach()

# Man pages: written sections with the options that the programs themselves print.
set(man_of_niliod 8)
set(man_of_nilio-publisher 8)
set(man_of_nilio-mapper 8)
set(man_of_nilio 1)
set(pages)
foreach(program niliod nilio-publisher nilio-mapper nilio)
  set(section ${man_of_${program}})
  set(template ${PROJECT_SOURCE_DIR}/docs/man/${program}.${section}.in)
  set(page ${CMAKE_CURRENT_BINARY_DIR}/man/${program}.${section})
  add_custom_command(
    OUTPUT ${page}
    COMMAND ${PROJECT_SOURCE_DIR}/cmake/package/man_page.sh $<TARGET_FILE:${program}> ${PROJECT_VERSION} ${template} ${page}
    DEPENDS ${program} ${template} cmake/package/man_page.sh cmake/package/help_to_man.awk
    COMMENT "Writing man page ${program}(${section})"
    VERBATIM)
  list(APPEND pages ${page})
  install(FILES ${page} DESTINATION ${CMAKE_INSTALL_MANDIR}/man${section} COMPONENT runtime)
endforeach()
add_custom_target(nilio_man_pages ALL DEPENDS ${pages})

# Units, and files of /etc, whose places depend on the prefix, which may be given when installing.
set(NILIO_VEHICLE_YAML ${PROJECT_SOURCE_DIR}/config/vehicle.yaml)
file(GLOB NILIO_UNITS CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/systemd/*.service)
configure_file(cmake/package/system_files.cmake.in system_files.cmake @ONLY)
install(SCRIPT ${CMAKE_CURRENT_BINARY_DIR}/system_files.cmake COMPONENT runtime)
install(FILES systemd/nilio.sysusers DESTINATION lib/sysusers.d RENAME nilio.conf COMPONENT runtime)
install(FILES systemd/nilio.tmpfiles DESTINATION lib/tmpfiles.d RENAME nilio.conf COMPONENT runtime)
install(FILES systemd/90-nilio.conf DESTINATION lib/sysctl.d COMPONENT runtime)
install(FILES systemd/niliod-can.conf systemd/nilio-can.network DESTINATION ${CMAKE_INSTALL_DOCDIR}/examples COMPONENT runtime)
install(FILES tools/view/monitoring/nilio.rules.yml tools/view/monitoring/grafana.json DESTINATION ${share}/nilio/monitoring COMPONENT runtime)
install(DIRECTORY tools/examples/ DESTINATION ${CMAKE_INSTALL_DOCDIR}/examples COMPONENT runtime)

include(CMakePackageConfigHelpers)
set(nilio_package ${CMAKE_INSTALL_LIBDIR}/cmake/nilio)
configure_package_config_file(cmake/nilioConfig.cmake.in nilioConfig.cmake INSTALL_DESTINATION ${nilio_package})
write_basic_package_version_file(nilioConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/nilioConfig.cmake ${CMAKE_CURRENT_BINARY_DIR}/nilioConfigVersion.cmake
        DESTINATION ${nilio_package} COMPONENT dev)
# For other build systems: pkg-config finds everything from its own file's place.
file(RELATIVE_PATH NILIO_PREFIX_OF_PC /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
string(REGEX REPLACE "/$" "" NILIO_PREFIX_OF_PC ${NILIO_PREFIX_OF_PC})
foreach(library nilio-core nilio-drivers)
  configure_file(cmake/package/${library}.pc.in ${library}.pc @ONLY)
  install(FILES ${CMAKE_CURRENT_BINARY_DIR}/${library}.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT dev)
endforeach()
install(FILES core/examples/odometry_from_kitti.cpp core/examples/odometry_from_pcap.cpp core/examples/CMakeLists.txt
        DESTINATION ${share}/doc/libnilio-dev/examples COMPONENT dev)
