# Installs what ./dev needs: Debian packages, a virtual environment in .dev/venv, a catkin workspace in .dev/ws.
# shellcheck shell=bash disable=SC2154  # sourced by ./dev, which sets here, state, venv and workspace

say() { printf '[dev] %s\n' "$*" >&2; }
die() { say "error: $*"; exit 1; }

# Characters in a path that CMake, make, catkin's setup files or ROS_PACKAGE_PATH do not quote.
odd_letter='[][:space:]:;"\\$%#&()<>|*?`'"'"'[]'
odd_letters="a space, a quote or one of : ; \\ \$ % # & ( ) < > | * ? [ ]"

# An installation of ROS outside Debian's archive; its packages are then not asked of apt.
opt_ros=
for distribution in noetic one; do
  if [ -z "$opt_ros" ] && [ -f "/opt/ros/$distribution/setup.bash" ]; then opt_ros=/opt/ros/$distribution; fi
done

os_release() { sed -n "s/^$1=//p" /etc/os-release 2>/dev/null | tr -d "\"'"; }
os_name() { local name; name=$(os_release PRETTY_NAME); printf '%s' "${name:-this system}"; }
os_codename() { local name; name=$(os_release UBUNTU_CODENAME); printf '%s' "${name:-$(os_release VERSION_CODENAME)}"; }

# Print the names of GROUP's packages (launch, rviz, page, test, lint or grade), one on each line.
packages_of() {
  local -n plain=$1_packages ros=$1_ros_packages
  printf '%s\n' "${plain[@]}"
  if [ -z "$opt_ros" ]; then printf '%s\n' "${ros[@]}"; fi
}
# Print the packages of GROUP... that are missing but available in the archive.
missing_packages() {
  local group
  comm -23 <(for group in "$@"; do packages_of "$group"; done | sed '/^$/d' | sort -u) \
    <({ dpkg-query -W -f='${Package} ${db:Status-Status}\n' | sed -n 's/ installed$//p'; cat "$state/absent"; } 2>/dev/null | sort -u)
}

in_list_of_releases() { [[ " ${ros_in_archive[*]} " == *" $(os_codename) "* ]]; }

# Take packages that the archive of a later release lacks out of the array `missing`, and name them.
leave_out_absent() {
  local absent
  apt-cache pkgnames | sort -u >"$state/archive"
  grep -qx python3-rospy "$state/archive" \
    || die "$(os_name) has no ROS 1 in its archive; use the container, or install ROS 1 into /opt/ros (docs/install.md)"
  mapfile -t absent < <(printf '%s\n' "${missing[@]}" | comm -23 - "$state/archive")
  [ ${#absent[@]} -gt 0 ] || return 0
  say "the archive of $(os_name) has no ${absent[*]}; continuing without (docs/install.md)"
  printf '%s\n' "${absent[@]}" >>"$state/absent"
  mapfile -t missing < <(printf '%s\n' "${missing[@]}" | comm -12 - "$state/archive")
}

# Show how far apt-get is: a line that counts in a terminal, otherwise a line every ten percent. In: its output with
# APT::Status-Fd=1. The rest of the output goes to the log $1.
show_progress() {
  local line shown=-1 percent doing stage=
  while IFS= read -r line; do
    if [[ $line =~ ^(dl|pm)status:[^:]*(:[a-z0-9]+)?:([0-9]+)[.0-9]*: ]]; then
      doing=$([ "${BASH_REMATCH[1]}" = dl ] && echo fetching || echo installing)
      percent=${BASH_REMATCH[3]}
      if [ "$doing" != "$stage" ]; then stage=$doing; shown=-1; fi
      if [ -t 2 ]; then
        [ "$percent" = "$shown" ] || printf '\r[dev] %s the packages: %3d %% ' "$doing" "$percent" >&2
        shown=$percent
      elif [ "$percent" -ge $((shown + 10)) ] || [ "$shown" -lt 0 ]; then
        say "$doing the packages: $percent %"
        shown=$percent
      fi
    else
      printf '%s\n' "$line" >>"$1"
      case $line in *"Waiting for cache lock"*) say "another program is installing packages; waiting for it" ;; esac
    fi
  done
  [ ! -t 2 ] || printf '\r%40s\r' '' >&2
}

unreachable='Temporary failure|Could not resolve|Could not connect|Network is unreachable|Failed to establish|Connection timed out|No route to host|roxyError|nnect to proxy|407 Proxy'

# End with the cause of a failed installation. In: name of the program, its log.
die_of_log() {
  local program=$1 log=$2 cause proxies
  [ -s "$log" ] || die "$program failed before it wrote its log $log"
  cause=$(grep -oE "($unreachable)[^(]*" "$log" | tail -n 1 | cut -c1-80) || true
  # apt and pip take the proxy from these; apt calls one that is dead a server that it could not connect to
  proxies=$(env | sed -nE 's#^(https?_proxy|all_proxy)=([a-z0-9]+://)?([^@/]*@)?([^/]+).*#\4#Ip' | sort -u | paste -sd' ')
  if [ -n "$proxies" ] && [ -n "$cause" ]; then
    die "$program could not reach its server through the proxy $proxies ($cause). Start the proxy, or unset http_proxy and https_proxy, and run this command again"
  fi
  [ -z "$cause" ] || die "$program could not reach its server ($cause). Check the network and run this command again"
  if grep -qE 'No space left on device|enough free space' "$log"; then
    die "$program failed because the disk is full: $(df -h "$here" | awk 'END {print $4}') are free, $disk_needed are needed. Free some space and run this command again"
  fi
  # pip writes the time before each line
  grep -E '(^|^[0-9T:-]+,[0-9]+ +)(E|ERROR):|fatal error' "$log" | tail -n 5 >&2 || tail -n 10 "$log" >&2
  die "$program failed; the whole log is $log"
}

disk_needed="2 GB"

# Install the packages of GROUP... that are missing.
install_debian_packages() {
  local missing remedy as_root=() log=$state/apt.log
  mapfile -t missing < <(missing_packages "$@")
  [ ${#missing[@]} -gt 0 ] || return 0
  command -v apt-get >/dev/null || die "$(os_name) has no apt-get; use the container (docs/install.md)"
  if [ "$(id -u)" -ne 0 ]; then
    remedy="ask an administrator to run: apt-get install --no-install-recommends ${missing[*]}"
    command -v sudo >/dev/null || die "you need root or sudo to install packages; $remedy"
    as_root=(sudo)
    say "${#missing[@]} Debian packages are missing; sudo may ask for your password"
    # sudo asks for the password here only, and one wrong answer must not end in an error of apt-get
    sudo env true || die "sudo does not let you install packages; $remedy"
  fi
  local apt=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive LC_ALL=C apt-get -o DPkg::Lock::Timeout=600)
  : >"$log"
  say "reading the archive's list of packages"
  "${apt[@]}" update >>"$log" 2>&1 || true      # a third party's broken source must not stop this one
  if [ -z "$opt_ros" ] && ! in_list_of_releases; then leave_out_absent; fi
  [ ${#missing[@]} -gt 0 ] || return 0
  # finish an installation that was interrupted
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive dpkg --configure -a >>"$log" 2>&1 || true
  local sizes
  sizes=$("${apt[@]}" install --no-install-recommends --assume-no "${missing[@]}" 2>&1 | tee -a "$log" \
    | sed -nE 's/^Need to get ([^ ]+) ([kMG]?B).*/\1 \2 to fetch/p; s/^After this operation, ([^ ]+) ([kMG]?B) of.*/\1 \2 of disk/p' \
    | paste -sd, | sed 's/,/, /') || true
  say "installing ${#missing[@]} Debian packages and their dependencies (${sizes:-sizes unknown}); the first time takes about 4 minutes"
  "${apt[@]}" -o APT::Status-Fd=1 install -y --no-install-recommends "${missing[@]}" 2>&1 | show_progress "$log" \
    || die_of_log apt-get "$log"
}

# done_before NAME FILE...: has step NAME been finished here with these very files, this Python and this ROS?
fingerprint() { { printf '%s\n' "$here" "$(readlink -f /usr/bin/python3)" "$opt_ros"; cat "$@"; } | cksum; }
done_before() { local name=$1; shift; [ "$(cat "$state/$name.done" 2>/dev/null)" = "$(fingerprint "$@")" ]; }
mark_done() { local name=$1; shift; fingerprint "$@" >"$state/$name.done"; }

# Print the entries of lock files for this Python, because pip names every other entry that it ignores.
requirements_here() {
  "$venv/bin/python" - "$@" <<'PYTHON'
import re, sys
from pip._vendor.packaging.markers import Marker  # pip's own

for file in sys.argv[1:]:
    for entry in re.findall(r"^\w.*(?:\n .*)*", open(file, encoding="utf-8").read(), re.MULTILINE):
        marker = re.search(r";([^\\\n]+)", entry)
        if not marker or Marker(marker[1].strip()).evaluate():
            print(entry)
PYTHON
}

# Run a command that may be silent for minutes, and say how far it is. In: seconds between two sentences, the shell
# command that prints one, the command.
run_with_progress() {
  local seconds=$1 how_far=$2 code=0 waited=0 beat
  # sleeps that are short: the last one outlives this function, and with it the pipe that the caller's output goes to
  (while sleep 1 && kill -0 $$ 2>/dev/null; do
    waited=$((waited + 1))
    [ $((waited % seconds)) -ne 0 ] || say "$(eval "$how_far")"
  done) 9>&- &
  beat=$!
  "${@:3}" || code=$?
  kill "$beat" 2>/dev/null || true
  return "$code"
}

# pip of .dev/venv, with a log of its own. Not .dev/venv/bin/pip, which names the folder that it was made in. It does not
# see the packages of ROS, which use_ros puts into PYTHONPATH.
venv_pip() { env -u PYTHONPATH PIP_USER=0 "$venv/bin/python" -m pip "$1" --disable-pip-version-check --log "$state/pip.log" "${@:2}"; }

# Install the lock files $2... into the virtual environment, except PyBullet; $1 says what they are.
pip_install() {
  say "installing $1 from PyPI into .dev/venv"
  requirements_here "${@:2}" | without_pybullet >"$state/requirements.txt"
  rm -f "$state/pip.log"
  # a bar for each package in a terminal, otherwise two lines; nothing while it unpacks, which takes minutes on a slow disk
  run_with_progress 20 "echo pip is still running" venv_pip install --require-hashes -r "$state/requirements.txt" >&2 \
    || die_of_log pip "$state/pip.log"
}

# Filters of entries of a lock file: PyBullet has a step of its own, because some machines have to compile it.
only_pybullet() { awk '/^[a-zA-Z]/ {here = /^pybullet/} here'; }
without_pybullet() { awk '/^[a-zA-Z]/ {here = !/^pybullet/} here'; }

# Install the requirement $1 from the wheels that were compiled here, if one fits.
install_kept_wheel() {
  [ -d "$state/wheels" ] \
    && venv_pip install --quiet --no-deps --no-index --find-links "$state/wheels" "$1" 2>/dev/null
}

# Install a wheel of PyBullet: one that was compiled before, otherwise PyPI's, otherwise one that is compiled now. pip
# decides which wheel fits this processor and Python.
install_pybullet() {
  local wanted=$state/pybullet.txt name
  requirements_here requirements/launch.txt | only_pybullet >"$wanted"
  name=$(grep -oE '^[^ ;\\]+' "$wanted")
  if install_kept_wheel "$name"; then return; fi
  say "installing PyBullet (0.1 GB) from PyPI into .dev/venv"
  rm -f "$state/pip.log"
  take_wheel() {
    venv_pip install --require-hashes --no-deps --only-binary pybullet,pybullet_arm64 -r "$wanted" >&2 2>"$state/pip.errors"
  }
  if run_with_progress 20 "echo pip is still running" take_wheel; then return; fi
  if ! grep -q 'No matching distribution' "$state/pip.errors" || grep -qE "$unreachable" "$state/pip.errors"; then
    die_of_log pip "$state/pip.log"
  fi
  say "PyPI has no wheel of PyBullet for $("$venv/bin/python" --version) on $(uname -m), so compiling it once, which takes about 7 minutes on one core of a PC and longer on a small board"
  install_debian_packages compile
  pip_install "the build tools of PyBullet" requirements/build.txt
  rm -rf "$state/compile"
  mkdir -p "$state/compile" "$state/wheels"
  rm -f "$state/pip.log"
  local flags="-O2 -DNDEBUG -fwrapv"   # Debian's without -g, which takes a third more time and memory
  compile() {
    TMPDIR=$state/compile CFLAGS=$flags CXXFLAGS=$flags venv_pip wheel --quiet --require-hashes --no-deps \
      --no-build-isolation --no-binary pybullet,pybullet_arm64 --wheel-dir "$state/wheels" -r "$wanted" >"$state/pip.errors" 2>&1
  }
  run_with_progress 30 "echo compiling PyBullet: \$(find '$state/compile' -name '*.o' | wc -l) of about 290 files" compile \
    || die_of_log pip "$state/pip.log"
  rm -rf "$state/compile"
  install_kept_wheel "$name" || die_of_log pip "$state/pip.log"
}

make_venv() {
  local site file=requirements/launch.txt
  done_before venv-launch "$file" && [ -x "$venv/bin/python" ] && return
  # the programs of an environment name the folder that it was made in, so a copy's programs would change the original
  if [ ! -L "$venv" ] && [ -e "$venv/bin/pip" ] && ! grep -qF "$venv/bin/python" "$venv/bin/pip"; then
    say "this clone was moved or copied to $here; making its .dev/venv again"
    rm -rf "$venv"
  fi
  # Debian's own python3, because rospy is built for it; installed packages are not fetched again
  if ! "$venv/bin/python" -c 'import pip' 2>/dev/null; then
    [ ! -L "$venv" ] || die ".dev/venv links to an incomplete environment. Remove the link"
    /usr/bin/python3 -m venv --clear "$venv"
  fi
  rm -f "$state"/venv-*.done
  pip_install "NumPy (20 MB)" "$file"
  # rospy comes from Debian. A path rather than --system-site-packages, so that Debian's own .pth files and /usr/local
  # stay out, which would put another matplotlib and another NumPy first.
  site=$("$venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
  echo /usr/lib/python3/dist-packages >"$site/debian.pth"
  # matplotlib brings a namespace package; Debian's, which has an __init__.py, would be taken in its place
  mkdir -p "$site/mpl_toolkits"
  touch "$site/mpl_toolkits/__init__.py"
  mark_done venv-launch "$file"
}

# Add PyBullet to the virtual environment, and the packages that the commands GROUP... need. A launch needs no others.
complete_venv() {
  local files=(requirements/launch.txt)
  if ! done_before venv-pybullet "${files[@]}"; then
    install_pybullet
    mark_done venv-pybullet "${files[@]}"
  fi
  files=(requirements/run.txt)
  case " $* " in *" page "* | *" grade "* | *" test "* | *" lint "*) ;; *) return 0 ;; esac
  if ! done_before venv-run "${files[@]}"; then
    pip_install "the packages of the web page, grading and plots (75 MB)" "${files[@]}"
    mark_done venv-run "${files[@]}"
  fi
  files=(requirements/test.txt requirements/cluster.txt)
  case " $* " in *" test "* | *" lint "*) ;; *) return 0 ;; esac
  if ! done_before venv-test "${files[@]}"; then
    pip_install "the packages of tests and checks" "${files[@]}"
    mark_done venv-test "${files[@]}"
  fi
}

# Bring the commands of the virtual environment and of ROS into the environment.
use_ros() {
  export PATH=$venv/bin:/usr/bin:$PATH
  # shellcheck disable=SC1091
  if [ -n "$opt_ros" ]; then source "$opt_ros/setup.bash"; fi
}

build_workspace() {
  local package=$workspace/src/husky_highlevel_controller entry log=$state/build.log
  local sources=(package.xml CMakeLists.txt setup.py cfg/* msg/* srv/* compat/gazebo_msgs/*.* compat/gazebo_msgs/*/* src/*/__init__.py src/*/controller/control.py src/*/controller/circle_screen.py)
  # a folder of links rather than one link: rosrun searches the package, and must not find .dev in it
  mkdir -p "$package"
  # delete links to files that are gone, and links of a clone that was moved or copied
  find "$package" -type l \( -xtype l -o ! -lname "$here/*" \) -delete
  for entry in *; do
    [ "$entry" = dev ] || [ -L "$package/$entry" ] || ln -s "$here/$entry" "$package/$entry"
  done
  done_before build "${sources[@]}" && [ -f "$workspace/devel/setup.bash" ] && return
  say "building the catkin workspace in .dev/ws"
  rm -rf "$workspace/build" "$workspace/devel"
  # cmake itself rather than catkin_make, which needs a C++ compiler
  { cmake -S "$package" -B "$workspace/build" -DCATKIN_DEVEL_PREFIX="$workspace/devel" \
      -DCMAKE_INSTALL_PREFIX="$workspace/install" -DPYTHON_EXECUTABLE="$venv/bin/python" -DCATKIN_ENABLE_TESTING=OFF \
    && cmake --build "$workspace/build" --parallel "$(nproc)"; } >"$log" 2>&1 \
    || { tail -n 20 "$log" >&2; die "the build failed; the whole log is $log"; }
  mark_done build "${sources[@]}"
}

# Take ROS 2, if the caller has sourced it, out of the environment: its packages bear the names of ROS 1's.
leave_out_ros2() {
  [ "${ROS_VERSION:-}" = 2 ] || [ -n "${AMENT_PREFIX_PATH:-}" ] || return 0
  local prefix variable entry kept prefixes=${AMENT_PREFIX_PATH:-}:${COLCON_PREFIX_PATH:-}
  if [ "${ROS_VERSION:-}" = 2 ]; then prefixes+=:/opt/ros/$ROS_DISTRO; fi
  say "this shell has ROS 2${ROS_DISTRO:+ ($ROS_DISTRO)} in its environment; ignoring it"
  for variable in PATH LD_LIBRARY_PATH CMAKE_PREFIX_PATH PKG_CONFIG_PATH ROS_PACKAGE_PATH; do
    kept=
    while IFS= read -r -d : entry; do
      while IFS= read -r -d : prefix; do
        case ${prefix:+$entry/} in "${prefix%/}"/*) entry= ;; esac
      done <<<"$prefixes:"
      kept+=${entry:+:$entry}
    done <<<"${!variable:-}:"
    if [ -n "$kept" ]; then export "$variable=${kept#:}"; else unset "$variable"; fi
  done
  unset AMENT_PREFIX_PATH AMENT_CURRENT_PREFIX COLCON_PREFIX_PATH ROS_DISTRO ROS_VERSION ROS_PYTHON_VERSION
}

# Make the installation complete for the package groups GROUP..., and bring it into the environment.
set_up() {
  case $here in *$odd_letter*) die "the folder '$here' has $odd_letters in its name, which ROS 1 and CMake cannot handle. Move it" ;; esac
  mkdir -p "$state" 2>/dev/null || die "cannot write to $here. Move the repository to a folder where you may write"
  [ -w "$state" ] || die "cannot write to $state, perhaps because of a sudo ./dev. Run sudo chown -R \"\$USER\" '$state'"
  touch "$state/CATKIN_IGNORE"
  leave_out_ros2
  local callers_packages=${ROS_PACKAGE_PATH:-}
  exec 9>"$state/lock"
  if command -v flock >/dev/null && ! flock -n 9; then
    say "waiting for another ./dev that is installing or building"
    flock 9
  fi
  # another Python (pyenv, conda, a PYTHONPATH) must not get between rospy and the venv
  unset PYTHONPATH PYTHONHOME CONDA_PREFIX VIRTUAL_ENV
  unset PYTHONDONTWRITEBYTECODE              # many images set it, and then each process would compile the package again
  export PYTHONNOUSERSITE=1
  export PYTHONUNBUFFERED=1                  # a log that is piped is seen line by line
  # NumPy's threads spin as each process imports it, 0.1 s of CPU time; no matrix here is large enough for them
  export OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}
  # CMake 4 refuses what says that it was written for CMake before 3.5, as most packages of ROS 1 do
  export CMAKE_POLICY_VERSION_MINIMUM=${CMAKE_POLICY_VERSION_MINIMUM:-3.5}
  install_debian_packages launch "$@"
  make_venv
  use_ros
  # the build needs NumPy, but none of the other packages, and unpacking those takes as long as the build
  build_workspace &
  local build=$!
  complete_venv "$@"
  wait "$build" || die "the workspace was not built; the whole log is $state/build.log"
  exec 9>&-
  # shellcheck disable=SC1091
  source "$workspace/devel/setup.bash" 2>"$state/source.log" || { cat "$state/source.log" >&2; exit 1; }
  case ":$ROS_PACKAGE_PATH:" in
    *":$workspace/src"*) ;;
    *) export ROS_PACKAGE_PATH=$workspace/src:${ROS_PACKAGE_PATH:-/usr/share} ;;   # Debian 13's catkin sets none
  esac
  if [ -n "$callers_packages" ]; then export ROS_PACKAGE_PATH=$ROS_PACKAGE_PATH:$callers_packages; fi
  export PATH=$venv/bin:$PATH
  if [ -z "$ROS_IP$ROS_HOSTNAME" ] && ! getent hosts "$(uname -n)" >/dev/null; then
    export ROS_IP=127.0.0.1                  # a host name that does not resolve stops every node
  fi
}

# Print the first folder in which ROS could not write its logs; nothing if there is none.
unwritable_log_folder() {
  local folder folders=("${ROS_HOME:-$HOME/.ros}" "${ROS_HOME:-$HOME/.ros}/log")   # log is root's after a sudo roslaunch
  if [ -n "${ROS_LOG_DIR:-}" ]; then folders=("$ROS_LOG_DIR"); fi
  for folder in "${folders[@]}"; do
    while [ "${1:-}" = look ] && [ ! -e "$folder" ]; do folder=$(dirname "$folder"); done   # whether it could be made
    { [ -e "$folder" ] || mkdir -p "$folder" 2>/dev/null; } && [ -d "$folder" ] && [ -w "$folder" ] || { echo "$folder"; return; }
  done
}

# End where ROS could not write its logs.
need_log_folder() {
  local folder
  folder=$(unwritable_log_folder)
  [ -z "$folder" ] \
    || die "cannot write logs to $folder. Set a folder where you may write, e.g. ROS_HOME=/tmp/ros ./dev ..., or take it over by sudo chown -R $(id -un) $folder"
}
