# find_package(helmholtz): defines the target helmholtz::helmholtz, the shared library with its header. Lies in share/cmake/helmholtz of the prefix.
get_filename_component(helmholtz_PREFIX "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
find_path(helmholtz_INCLUDE_DIR helmholtz.h HINTS "${helmholtz_PREFIX}/include" NO_DEFAULT_PATH)
find_library(helmholtz_LIBRARY helmholtz HINTS "${helmholtz_PREFIX}"
    PATH_SUFFIXES lib lib64 "lib/${CMAKE_LIBRARY_ARCHITECTURE}" NO_DEFAULT_PATH)
if(NOT helmholtz_INCLUDE_DIR OR NOT helmholtz_LIBRARY)
    set(helmholtz_FOUND FALSE)
    set(helmholtz_NOT_FOUND_MESSAGE "helmholtz.h or libhelmholtz is missing from ${helmholtz_PREFIX}")
    return()
endif()
if(NOT TARGET helmholtz::helmholtz)
    add_library(helmholtz::helmholtz SHARED IMPORTED)
    set_target_properties(helmholtz::helmholtz PROPERTIES
        IMPORTED_LOCATION "${helmholtz_LIBRARY}"
        INTERFACE_INCLUDE_DIRECTORIES "${helmholtz_INCLUDE_DIR}")
endif()
