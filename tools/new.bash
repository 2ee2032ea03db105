# `./dev new NAME [--cpp]`: a package with a node, a launch file and a rostest. Writes over nothing.
# shellcheck shell=bash disable=SC2154  # sourced by ./dev

name= kind=python
for argument in "$@"; do
  case $argument in
    --cpp) kind=cpp ;;
    -*) die "new has no option '$argument': ./dev new NAME [--cpp]" ;;
    *) [ -z "$name" ] || die "one package at a time: '$name' or '$argument'"; name=$argument ;;
  esac
done
[ -n "$name" ] || die "new what? e.g. ./dev new my_husky"
[[ $name =~ ^[a-z0-9][a-z0-9_]*[a-z0-9]$ && $name =~ [a-z] ]] \
  || die "'$name' is not a valid name of a ROS package: two or more of a-z, 0-9 and _, one of them a letter, no _ first or last"
# catkin only warns of such a package; a node of that name does not start
node=$(sed 's/^[^a-z]*//' <<<"$name")
[ "$node" = "$name" ] \
  || say "warning: the package name '$name' begins with a digit, which catkin warns of; name its nodes '$node...', because the name of a ROS node begins with a letter"
for share in "$here/compat" "${opt_ros:-/usr}/share"; do
  [ ! -e "$share/$name/package.xml" ] || die "ROS has a package '$name' already ($share/$name): take another name"
done
[ "$name" != husky_highlevel_controller ] || die "'$name' is the simulator's package: take another name"

folder=$caller
case $folder/ in "$here"/*) folder=$(dirname "$here") ;; esac        # beside the clone, not in it
workspace=
if [ "$kind" = cpp ] && [ "$(basename "$folder")" != src ]; then     # what is compiled needs a workspace
  workspace=$folder/${name}_ws
  folder=$workspace/src
elif [ "$kind" = cpp ]; then
  workspace=$(dirname "$folder")
fi
package=$folder/$name
[ ! -e "$package" ] || die "$package is there already; nothing is written over"
mkdir -p "$folder" 2>/dev/null && [ -w "$folder" ] || die "cannot write to $folder"
cp -r examples/first_node "$package"
if [ "$kind" = cpp ]; then
  rm -r "$package/scripts"
  cp -r examples/first_node_cpp/. "$package"
fi
find "$package" -type f -exec sed -i "s/first_node/$name/g" {} +
say "wrote $package; then:"
[ "$kind" = python ] || echo "$here/dev run catkin_make -C $(printf %q "$workspace")"
printf "%s %s %q\n" "$here/dev" launch "$package/launch/drive.launch" "$here/dev" "run rostest" "$package/test/drives.test"
