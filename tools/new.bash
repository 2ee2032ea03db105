# `./dev new NAME [--cpp]`: a package with a node, a launch file and a rostest. Writes over nothing.
# shellcheck shell=bash disable=SC2154  # sourced by ./dev

name= kind=python
for argument in "$@"; do
  case $argument in
    --cpp) kind=cpp ;;
    -*) die "'$argument' is not a valid option of new. Usage: ./dev new NAME [--cpp]" ;;
    *) [ -z "$name" ] || die "new takes one package name but got '$name' and '$argument'"; name=$argument ;;
  esac
done
[ -n "$name" ] || die "new needs a package name, e.g. ./dev new my_husky"
[[ $name =~ ^[a-z0-9][a-z0-9_]*[a-z0-9]$ && $name =~ [a-z] ]] \
  || die "'$name' is not a valid ROS package name. Use two or more of a-z, 0-9 and _, at least one letter, and no _ at either end"
# catkin only warns of such a package; a node of that name does not start
node=$(sed 's/^[^a-z]*//' <<<"$name")
[ "$node" = "$name" ] \
  || say "warning: the package name '$name' begins with a digit, so catkin warns; name its nodes '$node...', because a ROS node name must begin with a letter"
for share in "$here/compat" "${opt_ros:-/usr}/share"; do
  [ ! -e "$share/$name/package.xml" ] || die "ROS already has a package '$name' ($share/$name). Choose another name"
done
[ "$name" != husky_highlevel_controller ] || die "'$name' is the package of the simulator. Choose another name"

folder=$(cd "$caller" && pwd -P)
case $folder/ in "$here"/*) folder=$(dirname "$here") ;; esac        # next to the clone, not in it
workspace=
# a compiled package needs a workspace; the home folder is none, so ~/src is no folder of a workspace
if [ "$kind" = cpp ] && { [ "$(basename "$folder")" != src ] || [ "$(dirname "$folder")" -ef "$HOME" ]; }; then
  workspace=$folder/${name}_ws
  folder=$workspace/src
elif [ "$kind" = cpp ]; then
  workspace=$(dirname "$folder")
fi
package=$folder/$name
[ ! -e "$package" ] || die "$package already exists and is not overwritten. Choose another name, or move it"
mkdir -p "$folder" 2>/dev/null && [ -w "$folder" ] || die "cannot write to $folder. Run this command in a folder where you may write"
cp -r examples/first_node "$package"
if [ "$kind" = cpp ]; then
  rm -r "$package/scripts"
  cp -r examples/first_node_cpp/. "$package"
fi
find "$package" -type f -exec sed -i "s/first_node/$name/g" {} +
say "wrote $package; continue with:"
[ "$kind" = python ] || echo "$here/dev run catkin_make -C $(printf %q "$workspace")"
printf "%s %s %q\n" "$here/dev" launch "$package/launch/drive.launch" "$here/dev" "run rostest" "$package/test/drives.test"
