# Runs a program in a sourced workspace: PACKAGES HIDDEN SETUP.bash... -- PROGRAM [ARGUMENT...]
# PACKAGES are folders of packages that are found before all others, HIDDEN ones that are taken off PYTHONPATH;
# each is a list with ":" between its entries.
packages_first=$1
IFS=: read -r -a hidden_folders <<< "$2"
shift 2
while [ "$1" != -- ]; do
  source "$1" > /dev/null || exit 1
  shift
done
shift
path=":$PYTHONPATH:"
for folder in "${hidden_folders[@]}"; do
  while [[ $path == *":$folder:"* ]]; do path=${path//":$folder:"/:}; done
done
path=${path#:}
export PYTHONPATH=${path%:}
export ROS_PACKAGE_PATH="$packages_first${packages_first:+:}$ROS_PACKAGE_PATH"
exec "$@"
