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

# Print the names of GROUP's packages (launch, rviz, page, test, lint or grade), one a line.
packages_of() {
  local -n plain=$1_packages ros=$1_ros_packages
  printf '%s\n' "${plain[@]}"
  if [ -z "$opt_ros" ]; then printf '%s\n' "${ros[@]}"; fi
}
# Print those of the packages GROUP... that are not installed, without those that the archive has not.
missing_packages() {
  local group
  comm -23 <(for group in "$@"; do packages_of "$group"; done | sed '/^$/d' | sort -u) \
    <({ dpkg-query -W -f='${Package} ${db:Status-Status}\n' | sed -n 's/ installed$//p'; cat "$state/absent"; } 2>/dev/null | sort -u)
}

in_list_of_releases() { [[ " ${ros_in_archive[*]} " == *" $(os_codename) "* ]]; }

# Take the packages that the archive of a later release has not out of the array `missing`, and name them.
leave_out_absent() {
  local absent
  apt-cache pkgnames | sort -u >"$state/archive"
  grep -qx python3-rospy "$state/archive" \
    || die "$(os_name) has no ROS 1 in its archive: use the container, or install ROS 1 into /opt/ros (docs/install.md)"
  mapfile -t absent < <(printf '%s\n' "${missing[@]}" | comm -23 - "$state/archive")
  [ ${#absent[@]} -gt 0 ] || return 0
  say "the archive of $(os_name) has no ${absent[*]}: going on without (docs/install.md)"
  printf '%s\n' "${absent[@]}" >>"$state/absent"
  mapfile -t missing < <(printf '%s\n' "${missing[@]}" | comm -12 - "$state/archive")
}

# Show how far apt-get is: a line that counts in a terminal, else a line every ten percent. In: its output with
# APT::Status-Fd=1; the rest of it goes to the log $1.
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

# End with the cause of a failed installation whose output is in the log $1. In: name of the program, log.
die_of_log() {
  local unreachable='Temporary failure|Could not resolve|Could not connect|Network is unreachable|Failed to establish|Connection timed out|No route to host'
  if grep -qE "$unreachable" "$2"; then
    die "no network: $1 could not reach its server ($(grep -oE "($unreachable)[^(]*" "$2" | tail -n 1 | cut -c1-80)); connect and call this again"
  fi
  if grep -qE 'No space left on device|enough free space' "$2"; then
    die "$1: the disk is full ($(df -h "$here" | awk 'END {print $4}') left; $disk_needed are needed)"
  fi
  grep -E '^(E|ERROR):' "$2" | tail -n 5 >&2 || tail -n 10 "$2" >&2
  die "$1 failed; the whole log is $2"
}

disk_needed="2 GB"

# Install the packages of GROUP... that are missing.
install_debian_packages() {
  local missing as_root=() log=$state/apt.log
  mapfile -t missing < <(missing_packages "$@")
  [ ${#missing[@]} -gt 0 ] || return 0
  command -v apt-get >/dev/null || die "$(os_name) has no apt-get: use the container (docs/install.md)"
  if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null \
      || die "neither root nor sudo; ask for: apt-get install --no-install-recommends ${missing[*]}"
    as_root=(sudo)
    say "${#missing[@]} Debian packages are missing; sudo may ask for your password"
  fi
  local apt=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive LC_ALL=C apt-get -o DPkg::Lock::Timeout=600)
  : >"$log"
  say "reading the archive's list of packages"
  "${apt[@]}" update >>"$log" 2>&1 || true      # a third party's broken source must not stop this one
  if [ -z "$opt_ros" ] && ! in_list_of_releases; then leave_out_absent; fi
  [ ${#missing[@]} -gt 0 ] || return 0
  # what an installation that was interrupted has left half done
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive dpkg --configure -a >>"$log" 2>&1 || true
  local sizes
  sizes=$("${apt[@]}" install --no-install-recommends --assume-no "${missing[@]}" 2>&1 | tee -a "$log" \
    | sed -nE 's/^Need to get ([^ ]+) ([kMG]?B).*/\1 \2 to fetch/p; s/^After this operation, ([^ ]+) ([kMG]?B) of.*/\1 \2 of disk/p' \
    | paste -sd, | sed 's/,/, /') || true
  say "installing ${#missing[@]} Debian packages and what they need: ${sizes:-sizes unknown}; the first time takes some 4 minutes"
  "${apt[@]}" -o APT::Status-Fd=1 install -y --no-install-recommends "${missing[@]}" 2>&1 | show_progress "$log" \
    || die_of_log apt-get "$log"
}

# done_before NAME FILE...: has step NAME been finished with these very files?
fingerprint() { { printf '%s\n' "$here"; cat "$@"; } | cksum; }
done_before() { local name=$1; shift; [ "$(cat "$state/$name.done" 2>/dev/null)" = "$(fingerprint "$@")" ]; }
mark_done() { local name=$1; shift; fingerprint "$@" >"$state/$name.done"; }

# Print what lock files hold for this Python: of those for others pip names one by one that it ignores them.
requirements_here() {
  "$venv/bin/python" - "$@" <<'PYTHON'
import re, sys
from pip._vendor.packaging.markers import Marker  # as pip itself judges

for file in sys.argv[1:]:
    for entry in re.findall(r"^\w.*(?:\n .*)*", open(file, encoding="utf-8").read(), re.MULTILINE):
        marker = re.search(r";([^\\\n]+)", entry)
        if not marker or Marker(marker[1].strip()).evaluate():
            print(entry)
PYTHON
}

# Install the lock files $2... into the virtual environment; $1 says what they are.
pip_install() {
  local what=$1 log=$state/pip.log
  shift
  say "installing $what from PyPI into .dev/venv"
  rm -f "$log"
  requirements_here "$@" >"$state/requirements.txt"
  # a bar for each package in a terminal, else two lines
  # it says nothing while it unpacks, which takes minutes on a slow disk
  (while sleep 20 && kill -0 $$ 2>/dev/null; do say "pip is at work"; done) &
  local beat=$!
  "$venv/bin/pip" install --disable-pip-version-check --require-hashes --log "$log" -r "$state/requirements.txt" >&2 \
    || { kill "$beat"; die_of_log pip "$log"; }
  kill "$beat"
}

make_venv() {
  local site file=requirements/launch.txt
  done_before venv-launch "$file" && [ -x "$venv/bin/python" ] && return
  # Debian's own python3, because rospy is built for it; what is there already is not fetched again
  if ! "$venv/bin/python" -c 'import pip' 2>/dev/null; then
    [ ! -L "$venv" ] || die ".dev/venv is a link to an environment that is not whole: remove the link"
    /usr/bin/python3 -m venv --clear "$venv"
  fi
  rm -f "$state"/venv-*.done
  "$venv/bin/python" -c 'import sys; sys.exit(sys.version_info >= (3, 14))' || "$venv/bin/python" -c 'import pybullet' 2>/dev/null \
    || die "PyPI has no wheel of PyBullet for $("$venv/bin/python" --version): use the container or conda-forge, or compile it (docs/install.md)"
  pip_install "NumPy and PyBullet (0.12 GB)" "$file"
  # rospy comes from Debian. A path rather than --system-site-packages: Debian's own .pth files and /usr/local
  # stay out, which put another matplotlib and another NumPy in front of those that belong together.
  site=$("$venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
  echo /usr/lib/python3/dist-packages >"$site/debian.pth"
  # matplotlib brings a namespace package; Debian's, which has an __init__.py, would be taken in its place
  mkdir -p "$site/mpl_toolkits"
  touch "$site/mpl_toolkits/__init__.py"
  mark_done venv-launch "$file"
}

# Add what the commands GROUP... need to the virtual environment: none of it is needed to launch.
complete_venv() {
  local files=(requirements/run.txt)
  case " $* " in *" page "* | *" grade "* | *" test "* | *" lint "*) ;; *) return 0 ;; esac
  if ! done_before venv-run "${files[@]}"; then
    pip_install "what the page, marking and pictures need (75 MB)" "${files[@]}"
    mark_done venv-run "${files[@]}"
  fi
  files=(requirements/test.txt requirements/cluster.txt)
  case " $* " in *" test "* | *" lint "*) ;; *) return 0 ;; esac
  if ! done_before venv-test "${files[@]}"; then
    pip_install "what tests and checks" "${files[@]}"
    mark_done venv-test "${files[@]}"
  fi
}

build_workspace() {
  local package=$workspace/src/husky_highlevel_controller entry log=$state/build.log
  local sources=(package.xml CMakeLists.txt setup.py cfg/* msg/* srv/* src/*/__init__.py src/*/controller/control.py src/*/controller/pillar_detection.py)
  # a folder of links rather than one link: rosrun searches the package, and must not find .dev in it
  mkdir -p "$package"
  find "$package" -xtype l -delete
  for entry in *; do
    [ "$entry" = dev ] || [ -L "$package/$entry" ] || ln -s "$here/$entry" "$package/$entry"
  done
  done_before build "${sources[@]}" && [ -f "$workspace/devel/setup.bash" ] && return
  say "building the catkin workspace in .dev/ws"
  rm -rf "$workspace/build" "$workspace/devel"
  # cmake itself rather than catkin_make, which wants a C++ compiler
  { cmake -S "$package" -B "$workspace/build" -DCATKIN_DEVEL_PREFIX="$workspace/devel" \
      -DCMAKE_INSTALL_PREFIX="$workspace/install" -DPYTHON_EXECUTABLE="$venv/bin/python" -DCATKIN_ENABLE_TESTING=OFF \
    && cmake --build "$workspace/build"; } >"$log" 2>&1 \
    || { tail -n 20 "$log" >&2; die "the build failed; the whole log is $log"; }
  mark_done build "${sources[@]}"
}

# Make the installation complete for the package groups GROUP..., and bring it into the environment.
set_up() {
  case $here in *$odd_letter*) die "the folder '$here' has $odd_letters in its name, which ROS 1 and CMake cannot take: move it" ;; esac
  { mkdir -p "$state" 2>/dev/null && [ -w "$state" ]; } \
    || die "cannot write to $here: put the repository where you may write"
  touch "$state/CATKIN_IGNORE"
  local callers_packages=${ROS_PACKAGE_PATH:-}
  exec 9>"$state/lock"
  if command -v flock >/dev/null && ! flock -n 9; then
    say "waiting for another ./dev, which is installing or building"
    flock 9
  fi
  # another Python (pyenv, conda, a PYTHONPATH) must not get between rospy and the venv
  unset PYTHONPATH PYTHONHOME CONDA_PREFIX VIRTUAL_ENV
  unset PYTHONDONTWRITEBYTECODE              # many images set it: each process would compile the package anew
  export PYTHONNOUSERSITE=1
  export PYTHONUNBUFFERED=1                  # a log that is piped is seen line by line
  # NumPy's threads spin as each process imports it, 0.1 s of CPU time; no matrix here is large enough for them
  export OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}
  # CMake 4 refuses what says that it was written for CMake before 3.5, as most packages of ROS 1 do
  export CMAKE_POLICY_VERSION_MINIMUM=${CMAKE_POLICY_VERSION_MINIMUM:-3.5}
  install_debian_packages launch "$@"
  make_venv
  complete_venv "$@"
  export PATH=$venv/bin:/usr/bin:$PATH
  # shellcheck disable=SC1091
  if [ -n "$opt_ros" ]; then source "$opt_ros/setup.bash"; fi
  build_workspace
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

# End where ROS could not write its logs.
need_log_folder() {
  local folder=${ROS_LOG_DIR:-${ROS_HOME:-$HOME/.ros}}
  { mkdir -p "$folder" 2>/dev/null && [ -w "$folder" ]; } \
    || die "cannot write logs to $folder: name a folder where you may write, e.g. ROS_HOME=/tmp/ros ./dev ..."
}
