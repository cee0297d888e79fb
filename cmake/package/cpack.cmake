# The Debian packages nilio and libnilio-dev: cpack --config build/release/CPackConfig.cmake -B FOLDER
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME nilio)
set(CPACK_PACKAGE_VENDOR nilio)
set(CPACK_PACKAGE_CONTACT "nilio maintainers <maintainers@nilio.invalid>")
set(CPACK_PACKAGE_HOMEPAGE_URL "")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_INSTALL_PREFIX /usr)
# Installs with prefix /usr below a folder, so that the files of /etc land there.
set(CPACK_SET_DESTDIR ON)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL runtime dev)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_SECTION misc)
# lintian of Debian 12 does not read zstd.
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

set(CPACK_DEBIAN_RUNTIME_PACKAGE_NAME nilio)
set(CPACK_COMPONENT_RUNTIME_DESCRIPTION
    "LiDAR-inertial odometry daemon for Velodyne sensors
 niliod receives the packets of a Velodyne LiDAR and the frames of an IMU on
 CAN, and computes the vehicle's pose with every scan and every IMU sample.
 nilio-publisher publishes the poses over DDS, readable by ROS 2, and
 nilio-mapper builds a map of the drive. The command
 nilio records, replays, inspects, simulates, evaluates and plots drives.")
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_DEPENDS
    "systemd | systemd-standalone-sysusers | systemd-sysusers, systemd | systemd-standalone-tmpfiles | systemd-tmpfiles")
set(CPACK_DEBIAN_RUNTIME_PACKAGE_RECOMMENDS iproute2)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SUGGESTS "can-utils, ethtool, bash-completion")
set(scripts ${CMAKE_CURRENT_LIST_DIR})
set(CPACK_DEBIAN_RUNTIME_PACKAGE_CONTROL_EXTRA "${scripts}/postinst;${scripts}/prerm;${scripts}/postrm;${scripts}/conffiles")

set(CPACK_DEBIAN_DEV_PACKAGE_NAME libnilio-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_COMPONENT_DEV_DESCRIPTION
    "LiDAR-inertial odometry library, development files
 Headers, static libraries and the CMake package of nilio::core, the odometry,
 and of nilio::drivers, which turns packets of Velodyne LiDARs, CAN frames and
 recordings of them into scans and IMU samples.")
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS
    "libeigen3-dev (>= 3.4), libtbb-dev (>= 2021), libsleef-dev, libpcap-dev, libsocketcan-dev, libyaml-cpp-dev, libpugixml-dev, libsqlite3-dev, libzstd-dev, liblz4-dev, libbz2-dev, zlib1g-dev, pkg-config")

# Documents of Debian's packages and what lintian asks for beyond an installed tree.
string(TIMESTAMP NILIO_CHANGELOG_DATE "%a, %d %b %Y %H:%M:%S +0000" UTC)
configure_file(${scripts}/changelog.in debian_changelog @ONLY)
set(CPACK_NILIO_CHANGELOG ${CMAKE_CURRENT_BINARY_DIR}/debian_changelog)
set(CPACK_NILIO_COPYRIGHT ${scripts}/copyright)
set(CPACK_PRE_BUILD_SCRIPTS ${scripts}/finish_debs.cmake)
include(CPack)
