# Puts the Python messages of compat/gazebo_msgs at the end of PYTHONPATH. Catkin's setup file sources this file.
_gazebo_msgs=$CATKIN_ENV_HOOK_WORKSPACE/share/gazebo_msgs/python
case ":${PYTHONPATH:-}:" in
  *":$_gazebo_msgs:"*) ;;
  *) export PYTHONPATH="${PYTHONPATH:+$PYTHONPATH:}$_gazebo_msgs" ;;
esac
unset _gazebo_msgs
