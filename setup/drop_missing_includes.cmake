# Given to every CMake project of the workspace as CMAKE_PROJECT_INCLUDE.
#
# The exported targets of the ROS wheels name include folders of the machine that built the wheels. CMake
# refuses a target with an include folder that does not exist, so such folders are dropped here from the
# targets that find_package() brought in, and nothing in the virtual environment is edited.

function(joint_id_drop_missing_includes)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    foreach(property INTERFACE_INCLUDE_DIRECTORIES INTERFACE_SYSTEM_INCLUDE_DIRECTORIES)
      get_target_property(folders ${target} ${property})
      if(NOT folders)
        continue()
      endif()
      set(kept "")
      foreach(folder IN LISTS folders)
        if(NOT IS_ABSOLUTE "${folder}" OR EXISTS "${folder}")
          list(APPEND kept "${folder}")
        endif()
      endforeach()
      set_property(TARGET ${target} PROPERTY ${property} "${kept}")
    endforeach()
  endforeach()
endfunction()

# At the end of the project's own CMakeLists.txt every imported target is known.
cmake_language(DEFER CALL joint_id_drop_missing_includes)
