# `./dev doctor`: lists installed and missing parts, and checks whether ROS nodes can reach one another. Changes nothing.
# shellcheck shell=bash disable=SC2154  # sourced by ./dev

problems=0
good() { printf '  ok       %s\n' "$*"; }
note() { printf '  note     %s\n' "$*"; }
bad() { printf '  PROBLEM  %s\n' "$*"; problems=$((problems + 1)); }

check_system() {
  echo "This machine"
  if [ -n "$opt_ros" ]; then
    good "$(os_name), with ROS 1 in $opt_ros"
  elif in_list_of_releases || apt-cache show python3-rospy >/dev/null 2>&1; then
    good "$(os_name), with ROS 1 in its archive"
  else
    bad "$(os_name) has no ROS 1 in its archive; use the container (docs/install.md)"
  fi
  case $here in
    *$odd_letter*) bad "the folder '$here' has $odd_letters in its name; move it" ;;
    *) if [ -e "$state" ] && [ ! -w "$state" ]; then bad "the folder $state is not writable, perhaps because of a sudo ./dev; run sudo chown -R \"\$USER\" '$state'"
       elif [ -w "$here" ]; then good "the repository $here is writable"; else bad "the repository $here is not writable; move it to a folder where you may write"; fi ;;
  esac
  local free
  free=$(df -Pm "$here" | awk 'NR == 2 {print $4}')
  if [ "$free" -ge 2500 ] || [ -f "$state/build.done" ]; then good "$free MB of disk are free"
  else bad "$free MB of disk are free; an installation needs $disk_needed"; fi
  if [ "$(id -u)" -ne 0 ] && ! command -v sudo >/dev/null; then
    note "you need root or sudo to install packages; ask an administrator"
  fi
}

check_installation() {
  local group missing
  echo "Installed"
  for group in launch rviz test lint grade; do
    mapfile -t missing < <(missing_packages "$group")
    if [ ${#missing[@]} -eq 0 ]; then good "all Debian packages for '$group'"
    elif [ "$group" = launch ]; then bad "${#missing[@]} Debian packages for 'launch' are missing; ./dev setup installs them (${missing[*]})"
    else note "${#missing[@]} Debian packages for '$group' are missing; ./dev setup $group installs them (${missing[*]})"; fi
  done
  local lacking
  if done_before venv-launch requirements/launch.txt; then
    # the question of every program of the package at its start
    if lacking=$(PYTHONPATH=$here/src "$venv/bin/python" -m husky_highlevel_controller.missing_packages 2>&1); then
      good "Python packages in .dev/venv"
    else
      bad "${lacking##*error: }"
    fi
  else bad "Python packages in .dev/venv are missing or have another version; ./dev setup installs them"; fi
  if [ -f "$state/build.done" ] && [ -f "$workspace/devel/setup.bash" ]; then good "the workspace in .dev/ws is built"
  else bad "the workspace in .dev/ws is not built; ./dev setup builds it"; fi
  local folder
  folder=$(unwritable_log_folder look)
  if [ -z "$folder" ]; then good "logs go to ${ROS_LOG_DIR:-${ROS_HOME:-$HOME/.ros}}"
  else bad "cannot write logs to $folder; set ROS_HOME to a folder where you may write"; fi
}

# Test whether a program listens on port $2 of host $1.
# shellcheck disable=SC2016  # bash -c expands them
listens() { timeout 3 bash -c 'exec 3<>"/dev/tcp/$0/$1"' "$1" "$2" 2>/dev/null; }

# Topics on master $1 that are probably mistaken.
check_topics() {
  local sentence
  while read -r sentence; do bad "$sentence"; done < <(
    ROS_MASTER_URI=$1 PYTHONPATH=$here/src timeout 30 python3 -m husky_highlevel_controller.ros.simulator.wrong_topics
  )
}

# Report dependencies of the packages around the caller that are not packages.
check_packages() {
  [ -f "$workspace/devel/setup.bash" ] || return 0
  local sentence
  while read -r sentence; do [ -z "$sentence" ] || bad "$sentence"; done < <(
    source "$workspace/devel/setup.bash" 2>/dev/null
    PYTHONPATH=$here/src timeout 30 "$venv/bin/python" "$here/tools/find_packages.py" "$caller"
  )
}

check_network() {
  echo "The network of nodes"
  local uri=${ROS_MASTER_URI:-http://localhost:11311} name master port
  if [[ $uri =~ ^http://([^:/]+):([0-9]+)/?$ ]]; then
    master=${BASH_REMATCH[1]} port=${BASH_REMATCH[2]}
    if listens "$master" "$port"; then good "a ROS master answers at $uri"; check_topics "$uri"
    else note "no ROS master at $uri yet; ./dev launch starts one if that is this machine"; fi
    getent ahosts "$master" >/dev/null || bad "the host '$master' of ROS_MASTER_URI has no address on this machine; add it to /etc/hosts"
  else
    bad "ROS_MASTER_URI='$uri' is not of the form http://HOST:PORT"
  fi
  name=${ROS_HOSTNAME:-${ROS_IP:-$(uname -n)}}   # in this order, as ROS
  if getent ahosts "$name" >/dev/null; then good "nodes give their address as '$name', which resolves here"
  elif [ -n "$ROS_IP$ROS_HOSTNAME" ]; then bad "nodes give their address as '$name' (ROS_IP or ROS_HOSTNAME), which does not resolve here; correct it, or unset it"
  else note "the host name '$name' does not resolve here, so ./dev sets ROS_IP=127.0.0.1; nodes on other machines cannot reach nodes here"; fi
  if [ -z "$ROS_IP$ROS_HOSTNAME" ] && [ "${master:-localhost}" != localhost ] && [ "$master" != 127.0.0.1 ]; then
    note "the ROS master is on '$master'; set ROS_IP to the address of this machine in its network, otherwise its nodes cannot answer"
  fi
  if [ "$(date +%s)" -gt "$(stat -c %Y "$here/package.xml")" ]; then good "the clock says $(date '+%F %T')"
  else bad "the clock says $(date '+%F %T'), which is earlier than the files of this repository; set the clock"; fi
}

check_display() {
  echo "Windows"
  if [ -z "$DISPLAY" ]; then note "no display (DISPLAY is empty), so ./dev launch runs without RViz"
  elif [[ $DISPLAY =~ ^:([0-9]+) ]] && [ ! -S "/tmp/.X11-unix/X${BASH_REMATCH[1]}" ]; then
    bad "DISPLAY=$DISPLAY, but no X server listens there; unset DISPLAY, or run ./dev launch gui:=false"
  else good "display $DISPLAY"; fi
}

check_system
check_installation
check_packages
check_network
check_display
if [ "$problems" -eq 0 ]; then echo "No problem found."; else echo "$problems problem(s) found."; exit 1; fi
