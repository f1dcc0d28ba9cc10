# OpenVDB::Library: OpenVDB and what its headers need. (CMake does not search the folder of OpenVDB's own FindOpenVDB.cmake.)
find_path(OPENVDB_INCLUDE_DIR openvdb/openvdb.h)
find_library(OPENVDB_LIBRARY openvdb)
find_library(OPENVDB_IMATH_LIBRARY NAMES Imath-3_1 Imath)
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(OpenVDB REQUIRED_VARS OPENVDB_INCLUDE_DIR OPENVDB_LIBRARY OPENVDB_IMATH_LIBRARY)
set(OPENVDB_FOUND ${OpenVDB_FOUND})
if(OpenVDB_FOUND AND NOT TARGET OpenVDB::Library)
  add_library(OpenVDB::Library INTERFACE IMPORTED)
  set_target_properties(OpenVDB::Library PROPERTIES
    INTERFACE_INCLUDE_DIRECTORIES "${OPENVDB_INCLUDE_DIR}"
    INTERFACE_LINK_LIBRARIES "${OPENVDB_LIBRARY};${OPENVDB_IMATH_LIBRARY};TBB::tbb")
endif()
