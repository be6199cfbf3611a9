// The parts of three.js that race.html needs; scripts/vendor.sh bundles them, without the rest, as the global THREE.
export {
  Box3, BoxGeometry, CapsuleGeometry, CatmullRomCurve3, DirectionalLight, EdgesGeometry, Group, HemisphereLight,
  LineBasicMaterial, LineSegments, Mesh, MeshLambertMaterial, PerspectiveCamera, Scene, SphereGeometry, TubeGeometry,
  Vector3, WebGLRenderer,
} from "three";
